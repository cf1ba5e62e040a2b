"""`tensegrity-codegen cache`: where compiled libraries are kept, and how to remove them."""

from typing import Annotated

import typer

from tensegrity_codegen.cli.options import JsonOption
from tensegrity_codegen.cli.output import Output
from tensegrity_codegen.cli.verb import Verb


def cache(
    clear: Annotated[bool, typer.Option("--clear", help="Remove all libraries from the cache.")] = False,
    json: JsonOption = False,
) -> None:
    """Show where compiled libraries are kept, their number and size.

    A cache to which another user can have written is refused with exit code 2. Running processes keep the
    libraries that they have loaded when the cache is cleared.

    Example: tensegrity-codegen cache --clear
    """
    output = Output(json)
    with output.guard():
        from tensegrity_codegen.codegen.compilation.cache import Cache
        from tensegrity_codegen.system.cache_root import CACHE_VARIABLE
        from tensegrity_codegen.system.summaries import describe_count

        library_cache = Cache()
        removed = library_cache.count() if clear else 0
        freed = library_cache.clear() if clear else 0
        data = {
            "status": "ok",
            "folder": str(library_cache.root),
            "variable": CACHE_VARIABLE,
            "entries": (entries := library_cache.count()),
            "bytes": library_cache.size(),
            "limit_bytes": library_cache.limit,
            "removed_entries": removed,
            "freed_bytes": freed,
        }
        lines = [
            str(library_cache.root),
            f"{describe_count(entries, 'library', 'libraries')}, {_mebibytes(library_cache.size())} "
            f"of at most {_mebibytes(library_cache.limit)}",
        ]
        if clear:
            lines.append(f"removed {describe_count(removed, 'library', 'libraries')}, {_mebibytes(freed)}")
        output.result(data, "\n".join(lines))


def _mebibytes(size: int) -> str:
    return f"{size / 2**20:.1f} MiB"


VERB = Verb(cache, order=620)
