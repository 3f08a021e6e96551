"""How much a figure may cost, and on what it is computed."""

from typing import NamedTuple


class Effort(NamedTuple):
    """quick: coarse models, in seconds, to see that all works; engine, threads: of simulations; quiet: no progress."""

    quick: bool = False
    engine: str = "cpu"
    threads: int | None = None
    quiet: bool = False
