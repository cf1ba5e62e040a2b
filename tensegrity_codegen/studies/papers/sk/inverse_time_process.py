"""Times of forming inverses, measured in a process of its own in which linear algebra has one thread.

Libraries of linear algebra read their number of threads when they are loaded; on small matrices and busy
machines several threads spoil every measurement. Run as `python -m` with the numbers of nodes as arguments,
this module prints the times as one line of JSON.
"""

import json
import os
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from tensegrity_codegen.codegen.compilation.child import run_limited
from tensegrity_codegen.system.errors import TensegrityError

THREAD_VARIABLES = (
    *("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"),
    *("MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"),
)
TIME_LIMIT = 600.0  # [s]


class StudyError(TensegrityError):
    """A study of the papers that cannot be carried out."""


def measure_inverse_times(nodes: Iterable[int]) -> dict[str, Any]:
    """Return what `compare_inverse_times` returns, lists for arrays; raises StudyError with the log."""
    command = [sys.executable, "-m", __name__, *(str(int(n)) for n in nodes)]
    done = run_limited(
        command,
        folder=Path.cwd(),
        environment=os.environ | dict.fromkeys(THREAD_VARIABLES, "1"),
        timeout=TIME_LIMIT,
    )
    if not done.ok:
        raise StudyError(
            f"the times of inverses could not be measured: {done.ended} {done.number}\n{done.log.strip()}",
            hint="free the machine of other work, or choose another paper",
        )
    result: dict[str, Any] = json.loads(done.log.strip().splitlines()[-1])
    return result


def _plain(value: Any) -> Any:
    """Return dictionaries and arrays in JSON's types."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    return np.asarray(value).tolist()


def _main(arguments: list[str]) -> None:
    from tensegrity_codegen.studies.papers.sk.inverse_time import compare_inverse_times

    sys.stdout.write(json.dumps(_plain(compare_inverse_times(int(word) for word in arguments))) + "\n")


if __name__ == "__main__":
    _main(sys.argv[1:])
