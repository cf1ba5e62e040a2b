"""The processor by the name that it gives itself, for the foot of a page of measurements."""

import platform
from pathlib import Path


def name_processor() -> str:
    """Return the processor's model as the system states it, or its architecture."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return platform.processor() or platform.machine()
    for line in text.splitlines():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.machine()
