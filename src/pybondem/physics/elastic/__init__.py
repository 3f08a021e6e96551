"""Elastic forms: one published form per file, as the four stiffnesses of a bond."""
