"""python -m pybondem."""

from pybondem.cli import main

main()
