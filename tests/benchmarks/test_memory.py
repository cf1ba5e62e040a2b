"""The peak of a process and its children together, as the measurement of the largest scene takes it."""

import subprocess
import sys

import pytest
from harness.run import run_watched

MB = 2**20

# Holds 60 MB while a child holds 90 MB more, after a child that held nothing.
FAMILY = """
import subprocess, sys
held = bytearray(b"x") * (60 * 2**20)
for size in (0, 90 * 2**20):
    text = f"import time; held = bytearray(b'x') * {size}; time.sleep({0.02 * size / 2**20})"
    subprocess.run([sys.executable, "-c", text], check=True)
print("done")
"""


@pytest.mark.skipif(sys.platform != "linux", reason="needs /proc")
def test_parent_and_child_count_together_and_no_more() -> None:
    done = run_watched([sys.executable, "-c", FAMILY], 120.0)
    assert (done.returncode, done.stdout.strip()) == (0, "done")
    assert done.peak is not None
    assert 150 * MB < done.peak < 230 * MB


def test_a_failure_keeps_its_words() -> None:
    done = run_watched([sys.executable, "-c", "import sys; sys.exit('no')"], 60.0)
    assert done.returncode == 1
    assert done.stderr.strip() == "no"


def test_what_takes_too_long_is_ended() -> None:
    with pytest.raises(subprocess.TimeoutExpired):
        run_watched([sys.executable, "-c", "import time; time.sleep(60)"], 0.2)
