"""Profiles in CSV files: a column of times, and one for each input."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tensegrity_codegen.runtime.profiles.profile import Profile
from tensegrity_codegen.scene.formats.files.csv_table import Row, read_table
from tensegrity_codegen.system.checks import check_names, check_path
from tensegrity_codegen.system.errors import InvalidValueError, TensegrityError

TIME_COLUMN = "time"


def read_profile(path: str | Path, input_name: Sequence[str], kind: Any = "linear") -> Profile:
    """Read the values of inputs over time from a CSV file.

    Parameters
    ----------
    path : str or Path
        File with a header: the column ``time`` [s] and a column for each input that changes, in the unit of
        the input. Rows are knots, as of `Profile`.
    input_name : sequence of str
        Names of the inputs of the model (``model.manifest.input_name``).
    kind : str
        ``"linear"`` or ``"cubic"``, as of `Profile`.

    Returns
    -------
    Profile
        The knots, for ``simulate(schedule=...)``.

    Raises
    ------
    SceneError
        The file cannot be read, is empty or no table.
    UnknownKeyError
        A column that is no input.
    DuplicateNameError
        A column appears twice.
    InvalidValueError
        A cell that is no number, no column ``time`` or no other one, and what `Profile` raises.
    NonFiniteError
        A number that is not finite.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tensegrity_codegen import read_profile
    >>> _ = Path("pull.csv").write_text("time,motor\\n0,0\\n0.5,0.01\\n1,0.01\\n")
    >>> read_profile("pull.csv", ["motor"]).values["motor"].tolist()
    [0.0, 0.01, 0.01]
    """
    check_path(path, "path")
    file, input_name = Path(path), check_names(input_name, "input_name")
    if not input_name:
        raise InvalidValueError(
            "the scene has no inputs that a profile could change",
            where=str(file),
            hint="state them under [[inputs]] in the scene",
        )
    rows = read_table(file, (TIME_COLUMN, *input_name), (TIME_COLUMN,))
    names = [name for name in (rows[0].cells if rows else ()) if name != TIME_COLUMN]
    if not names:
        raise InvalidValueError(
            "the profile has no rows" if not rows else "the profile has no column of an input",
            where=str(file),
            allowed=f"rows with time and {' or '.join(input_name)}",
        )
    columns = {name: [_read_cell(row, name) for row in rows] for name in (TIME_COLUMN, *names)}
    try:
        return Profile(columns.pop(TIME_COLUMN), columns, kind)
    except TensegrityError as error:
        error.where = f"{file}: {error.where}"
        raise


def _read_cell(row: Row, name: str) -> float:
    row.text(name)  # which refuses an empty cell
    return float(row.number(name) or 0.0)
