"""The harness is no package of the wheel: it is imported from the folder benchmarks/."""

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent.parent
sys.path[:0] = [str(ROOT / "benchmarks"), str(ROOT / "docs")]
