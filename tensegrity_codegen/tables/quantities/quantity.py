"""One row of the table of quantities and arguments."""

import re
from collections.abc import Container
from dataclasses import dataclass

# The works that a source names by the words before its section.
REFERENCES = {
    "S&K": 'S. I. Savin, R. R. Khusainov, "Sparse Node-Distance Coordinate Representation for Tensegrity '
    'Structures", Russian Journal of Nonlinear Dynamics, 18 (5), 2022, pp. 885-898, doi:10.20537/nd221225.',
    "SCS": 'C. Sultan, M. Corless, R. E. Skelton, "Symmetrical reconfiguration of tensegrity structures", '
    "International Journal of Solids and Structures, 39 (8), 2002, pp. 2215-2234.",
    "LIN": 'M. Lin, T. Li, Z. Ji, M. Che, "Force-displacement relationships of a tensegrity structure '
    'considering bar interference".',
    "Hunt and Crossley 1975": 'K. H. Hunt, F. R. E. Crossley, "Coefficient of restitution interpreted as '
    'damping in vibroimpact", Journal of Applied Mechanics, 42 (2), 1975, pp. 440-445, '
    "doi:10.1115/1.3423596.",
}

# What a sentence says of a feature that a structure can lack, and what it says without it; in this order.
WITHOUT = (
    ("rigid bars", r" and (?:in |of )?rigid bars(?:, whose tensions are multipliers)?", ""),
    ("slack cables", r"slack cables and (?:in |of )?(?=rigid)", ""),
    ("slack cables", r"; (?:zero|negative) in (?:the (?:rows|columns) of )?slack cables", ""),
    ("slack cables", r"(of|each) taut member", r"\1 member"),
    ("damping", r" \+ c_e l_e'(?! /)| \(no damping\)", ""),
    ("damping", r"min\(l_e - rho_e, l_e - rho_e \+ c_e l_e' / mu_e\)", "l_e - rho_e"),
)


def fit_sentence(sentence: str, features: Container[str]) -> str:
    """Return the sentence of a quantity for a structure with these of the features of WITHOUT."""
    for feature, pattern, replacement in WITHOUT:
        if feature not in features:
            sentence = re.sub(pattern, replacement, sentence)
    return sentence


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
