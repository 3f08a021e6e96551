"""Engines: who runs the loops."""
