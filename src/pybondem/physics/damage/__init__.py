"""Damage laws: one published law per file. A law turns deformation and memory into damage, 0 <= D <= 1."""
