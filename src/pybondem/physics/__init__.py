"""Pure physics: numbers in, numbers out, in the words of `ops` alone."""
