"""One row of the table of quantities and arguments."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Quantity:
    """One row of the table; `sparse` results are handed out as compressed columns."""

    name: str
    symbol: str
    unit: str
    shape: tuple[str, ...]
    sentence: str
    source: str = "S&K 2"
    sparse: bool = False

    @property
    def over_bar_pairs(self) -> bool:
        """Whether the quantity runs over pairs of bars."""
        return bool({"n_bar_pairs", "n_bar_points"}.intersection(self.shape))

    @property
    def over_columns(self) -> bool:
        """Whether the quantity has one column for each number that motions are differentiated to."""
        return "n_columns" in self.shape or self.follows_state

    @property
    def follows_state(self) -> bool:
        """Whether these columns stand behind a part of their length that does not depend on them."""
        return "n_followed" in self.shape
