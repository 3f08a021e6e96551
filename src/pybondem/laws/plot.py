"""Drawing (being written)."""


def plot_law(law, path=None):
    """Draw."""
    raise NotImplementedError
