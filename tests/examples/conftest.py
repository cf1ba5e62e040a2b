"""The runner of the examples is no package of the wheel: it is imported from the folder examples/."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples"))
