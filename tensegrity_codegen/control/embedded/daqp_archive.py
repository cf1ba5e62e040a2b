"""The source archive of DAQP: a file of the user, the copy in the cache, or what pip downloads; verified."""

from pathlib import Path

from tensegrity_codegen.system.pinned_file import PinnedFile

DAQP_VERSION = "0.11.0"
DAQP_ARCHIVE = f"daqp-{DAQP_VERSION}.tar.gz"
DAQP_SHA256 = "2f27baf18d2acca14186498e651b34e0bed455627e777d3fd8ba655e7e40f920"
DAQP = PinnedFile(
    package="daqp",
    version=DAQP_VERSION,
    file=DAQP_ARCHIVE,
    sha256=DAQP_SHA256,
    title="the source archive of DAQP",
    is_source=True,
    hand="daqp_sdist=PATH",
)


def find_daqp_archive(file: str | Path | None = None) -> bytes:
    """Return the source archive of DAQP, of the pinned version and SHA-256.

    Parameters
    ----------
    file : path, optional
        The archive; by default the copy in the cache of this package, else pip downloads it from the index
        that pip is configured for, and it is kept in the cache.

    Returns
    -------
    bytes
        The archive, a .tar.gz.

    Raises
    ------
    MissingSourceError
        The file cannot be read, is another one, or pip cannot download it.
    """
    return DAQP.find(file)
