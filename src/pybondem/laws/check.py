"""The battery (being written)."""


def check_law(law, engines=None, quiet=False):
    """Check."""
    raise NotImplementedError
