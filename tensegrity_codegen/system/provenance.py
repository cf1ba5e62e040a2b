"""Where and when figures were measured, for the foot of a page."""

import os
import platform
from datetime import UTC, datetime

import numpy as np

from tensegrity_codegen.system.processor import name_processor
from tensegrity_codegen.system.version import VERSION


def describe_provenance() -> tuple[str, str]:
    """Return two sentences: versions; day and machine.

    The day is that of SOURCE_DATE_EPOCH [s] where this variable of the environment is a number of seconds.
    """
    text = os.environ.get("SOURCE_DATE_EPOCH", "")
    day = datetime.fromtimestamp(int(text), UTC) if text.isdecimal() else datetime.now(UTC)
    return (
        f"tensegrity_codegen {VERSION}, Python {platform.python_version()}, NumPy {np.__version__}.",
        f"Written on {day:%Y-%m-%d}; {name_processor()}, {platform.system()} {platform.machine()}.",
    )
