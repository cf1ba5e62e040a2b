"""The machine and time of measured figures, for the foot of a page."""

import os
import platform
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from tensegrity_codegen.system.version import VERSION


def name_processor() -> str:
    """Return the processor's model as the system states it, or its architecture."""
    try:
        content = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return platform.processor() or platform.machine()
    for line in content.splitlines():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.machine()


def describe_provenance() -> tuple[str, str]:
    """Return two sentences: versions; day (that of SOURCE_DATE_EPOCH [s] if it is set) and machine."""
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "")
    day = datetime.fromtimestamp(int(epoch), UTC) if epoch.isdecimal() else datetime.now(UTC)
    return (
        f"tensegrity_codegen {VERSION}, Python {platform.python_version()}, NumPy {np.__version__}.",
        f"Written on {day:%Y-%m-%d}; {name_processor()}, {platform.system()} {platform.machine()}.",
    )
