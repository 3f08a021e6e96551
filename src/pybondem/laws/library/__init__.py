"""Published laws, one in each file, each written as a user would write one; `pybondem.laws` lists them."""
