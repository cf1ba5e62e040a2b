"""Open the results of a sweep."""

from pathlib import Path
from typing import Any

from tensegrity_codegen.sweeps.store.folder import RECORD, check_not_damaged, read_stored_sweep
from tensegrity_codegen.system.extras import SWEEP, import_extra


def open_sweep(path: str | Path) -> Any:
    """Open the results of a sweep, finished or not; arrays are verified, and read when they are used.

    Parameters
    ----------
    path : str or Path
        The folder that `sweep` wrote.

    Returns
    -------
    xarray.Dataset
        One variable a quantity, units and description in its attributes; dimensions are the axes of the grid
        or ``case``, then ``time``, ``node``, ``member``. Cases that are not computed yet have the status -1.

    Raises
    ------
    MissingExtraError
        xarray or Zarr is not installed.
    OutputError
        The folder is not a sweep, or files in it are damaged or missing.
    """
    stored = read_stored_sweep(path)
    check_not_damaged(stored)
    import_extra("zarr", SWEEP)
    xarray = import_extra("xarray", SWEEP)
    found = xarray.open_zarr(str(stored.path), chunks=None, consolidated=True, zarr_format=3)
    return found.drop_vars(RECORD)
