"""What a foreign-function interface has to know of a library: types and functions, from its own header."""

import re

SPANS = re.compile(r"/\*.*?\*/|#ifdef __cplusplus\n.*?#endif|^#[^\n]*", re.DOTALL | re.MULTILINE)
CONSTANTS = re.compile(r"enum (?:\w+ )?\{[^}]*\};|extern \w+_API const \w+ \w+\[[^;]*;")
SPACE = re.compile(r"\s+")


def read_declarations(header: str) -> str:
    """Return types and functions of a generated header, one a line, as C that cffi reads.

    Comments, directives, enumerations and the arrays of constants are dropped.
    """
    text = CONSTANTS.sub("", SPANS.sub("", header))
    text = SPACE.sub(" ", re.sub(r"\b\w+_API ", "", text)).strip()
    text = text.replace("extern const ", "extern ")  # cffi reads no constants but whole numbers
    return re.sub(r"; (?=typedef|extern|int|const)(?![^{]*\})", ";\n", text)
