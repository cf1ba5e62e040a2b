"""The texts of `keep`: an expression over quantities, and its reduction over time.

    member_tension                      of motions: at every sample
    member_tension.max                  largest over time, member by member; also min, mean, rms, final
    node_position[t1].final             an entry by its name or number
    max(member_tension).every(10)       at every tenth sample
    first(member_tension[c1] < 0.5)     first time at which a comparison holds [s]
    height = node_position[t1, z].max   under a name of its own

Expressions are those of end conditions of motions (runtime/simulate/condition_text.py).
"""

import ast
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from tensegrity_codegen.analyses.cases.record import Output
from tensegrity_codegen.runtime.model.interface import name_states
from tensegrity_codegen.runtime.simulate.condition_text import POSITION, parse_condition
from tensegrity_codegen.system.errors import (
    DuplicateNameError,
    InvalidValueError,
    TensegrityError,
    UnknownNameError,
    suggest,
)
from tensegrity_codegen.tables.manifest import FunctionSpec, Manifest
from tensegrity_codegen.tables.precision import find_precision
from tensegrity_codegen.tables.quantities import QUANTITIES

AXES = ("x", "y", "z")


def describe_quantity(manifest: Manifest, spec: FunctionSpec) -> Output:
    """Return one quantity of a library as an output; sparse matrices become dense arrays."""
    row = QUANTITIES[spec.quantity]
    dims: list[str] = []
    labels: dict[str, tuple[Any, ...]] = {}
    for size_name, size in zip(row.shape, spec.shape, strict=True):
        dim, names = label_axis(manifest, size_name, spec.quantity)
        while dim in dims:  # columns of a square matrix
            dim = f"{dim}_column"
        dims.append(dim)
        if len(names) == size:
            labels[dim] = names
    return Output(
        name=spec.quantity,
        dims=tuple(dims),
        shape=tuple(spec.shape),
        dtype=real_dtype(manifest),
        unit=spec.unit,
        sentence=spec.sentence,
        coordinates=labels,
    )


def label_axis(manifest: Manifest, size_name: str, quantity: str) -> tuple[str, tuple[str, ...]]:
    """Return name and labels of an axis that the table of quantities calls `word`, such as "n_members"."""
    names: dict[str, tuple[str, ...]] = {
        "n_nodes": manifest.node_name,
        "n_members": manifest.member_name,
        "n_coordinates": manifest.coordinate_name,
        "n_states": name_states(manifest),
        "n_inputs": manifest.input_name,
        "n_bar_pairs": manifest.bar_pair_name,
        "n_axes": tuple(AXES[axis] for axis in manifest.axes),
    }
    if size_name == "n_axes":  # axes of planar scenes are fewer than those of positions in space
        return "axis" if len(manifest.axes) == len(AXES) else "plane_axis", names[size_name]
    return _name_axis(size_name, quantity), names.get(size_name, ())


def _name_axis(size_name: str, quantity: str) -> str:
    if size_name.startswith("n_"):
        return size_name.removeprefix("n_").removesuffix("s").replace("switche", "switch")
    return f"{quantity}_{size_name}"


def list_axis_names() -> frozenset[str]:
    """Return the names that axes of any quantity of any structure have."""
    names = {_name_axis(size_name, name) for name, row in QUANTITIES.items() for size_name in row.shape}
    names |= {"axis", "plane_axis", "mode"}
    return frozenset(names | {f"{name}_column" for name in names})


def real_dtype(manifest: Manifest) -> str:
    """Return the type of the library's numbers, "float64" or "float32"."""
    return str(find_precision(manifest.precision).dtype)


REDUCTIONS = ("final", "max", "min", "mean", "rms")
EVERY, FIRST = "every", "first"
LABEL = re.compile(r"\s*([A-Za-z]\w*)\s*=(?!=)\s*(.*)", re.DOTALL)
ALLOWED = f"EXPRESSION, EXPRESSION.{'|'.join(REDUCTIONS)}, EXPRESSION.{EVERY}(k), {FIRST}(CONDITION)"
# Names of arrays and attributes that every store has.
TAKEN = ("case", "sample", "status", "message", "task", "task_record", "time")


@dataclass(frozen=True)
class KeptText:
    """One parsed text of `keep`.

    name: of the array of results.
    text: as it was written, without the name.
    expression: the expression or condition in it.
    reduction: one of REDUCTIONS, ``"every"``, ``"first"``; empty for every sample, or without
        time.
    step: of ``"every"``: samples from one that is kept to the next.
    """

    name: str
    text: str
    expression: str
    reduction: str = ""
    step: int = 1

    @property
    def text_beside_name(self) -> str:
        """The text, empty if it is the name."""
        return "" if self.name == self.text else self.text

    @property
    def tree(self) -> ast.expr:
        """The checked syntax tree of the expression."""
        return parse_condition(self.expression)


def parse_kept(
    texts: Sequence[str], results: Sequence[str] = (), *, over_time: bool = False
) -> tuple[KeptText, ...]:
    """Return the parsed texts, each under a name of its own; raises SceneError for an invalid text."""
    kept_texts: list[KeptText] = []
    for entry in texts:
        try:
            kept_text = _parse_one(entry, results)
            _check_time(kept_text, over_time=over_time)
        except TensegrityError as error:
            error.where = f"keep {entry!r}"
            raise
        kept_texts.append(_name_apart(kept_text, kept_texts, is_labelled=LABEL.fullmatch(entry) is not None))
    return tuple(kept_texts)


def _parse_one(text: str, results: Sequence[str]) -> KeptText:
    labelled = LABEL.fullmatch(text)
    label, body = labelled.groups() if labelled else ("", text)
    body = body.strip()
    kept_text = KeptText(label or _make_name(body), body, *_split(body))
    if _is_taken(label):
        raise InvalidValueError(
            "sweeps have an array or an axis of this name", where="keep", given=label, allowed="another name"
        )
    if kept_text.expression in results:
        return kept_text
    _check_reduction(body)
    try:
        tree = parse_condition(kept_text.expression)
    except TensegrityError as error:
        if kept_text.expression.isidentifier() and results:
            error.hint = suggest(kept_text.expression, [*QUANTITIES, *results])
        raise
    if (kept_text.reduction == FIRST) is not isinstance(tree, ast.Compare):
        raise InvalidValueError(
            "the first time of something that is no comparison"
            if kept_text.reduction == FIRST
            else "a comparison has no values to keep",
            where="keep",
            given=text,
            allowed=ALLOWED,
            hint="first(member_tension[c1] < 0.5) is the first time at which it holds",
        )
    return kept_text


def _split(body: str) -> tuple[str, str, int]:
    """Return expression, reduction and step of a text."""
    try:
        tree = ast.parse(body, mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return body, "", 1  # parse_condition raises the error
    if isinstance(tree, ast.Attribute) and tree.attr in REDUCTIONS:
        return _text_of(body, tree.value), tree.attr, 1
    if not isinstance(tree, ast.Call):
        return body, "", 1
    called, arguments = tree.func, tree.args
    if isinstance(called, ast.Name) and called.id == FIRST and len(arguments) == 1:
        return _text_of(body, arguments[0]), FIRST, 1
    if not (isinstance(called, ast.Attribute) and called.attr in (EVERY, *REDUCTIONS)):
        return body, "", 1
    step = arguments[0].value if len(arguments) == 1 and isinstance(arguments[0], ast.Constant) else None
    if called.attr != EVERY or type(step) is not int or step < 1:
        raise InvalidValueError(
            "not a reduction over time",
            where="keep",
            given=body,
            allowed=ALLOWED,
            hint="every(10) keeps every tenth sample, with a whole number from 1 on",
        )
    return _text_of(body, called.value), EVERY, step


def _check_reduction(body: str) -> None:
    """Raise UnknownNameError for `member_tension.median`: a quantity followed by no known reduction."""
    match = re.search(r"(?:^|[^\w.])(\w+)(?:\[[^\]]*\])?\.([A-Za-z]\w*)(?:\([^()]*\))?$", body)
    if match is not None and match[1] in QUANTITIES and match[2] not in (*REDUCTIONS, EVERY, *"xyz"):
        if match[1] == POSITION or "[" in body:
            return  # components of points: parse_condition knows their names
        raise UnknownNameError(
            "unknown reduction over time",
            where="keep",
            given=match[2],
            allowed=f"{', '.join(REDUCTIONS)}, {EVERY}(k)",
            hint=suggest(match[2], [*REDUCTIONS, EVERY]),
        )


def _is_taken(name: str) -> bool:
    """Return whether every store has an array of this name, or an axis of some result has it."""
    return name in TAKEN or name in list_axis_names() or name.startswith(f"time_{EVERY}_")


def _text_of(source: str, node: ast.expr) -> str:
    return ast.get_source_segment(source, node) or ast.unparse(node)


def _check_time(kept_text: KeptText, *, over_time: bool) -> None:
    """Raise InvalidValueError for a reduction over time, or the time itself, without samples over time."""
    if over_time:
        return
    if kept_text.reduction or re.search(r"(?<![\w.])time(?!\w)", kept_text.expression):
        raise InvalidValueError(
            "there is no time to reduce over",
            where="keep",
            given=kept_text.text,
            allowed="an expression over quantities",
            hint="reductions are for motions, do = simulate",
        )


def _make_name(body: str) -> str:
    """Return letters, digits and underscores of a text, beginning with a letter."""
    name = re.sub(r"[^A-Za-z0-9_]+", "_", body).strip("_")
    return name if name[:1].isalpha() else f"value_{name}".rstrip("_")


def _name_apart(kept_text: KeptText, earlier: Sequence[KeptText], *, is_labelled: bool) -> KeptText:
    """Return the parsed text under an unused name; equal texts and stated names are refused."""
    names = [kept_before.name for kept_before in earlier]
    if kept_text.text in [kept_before.text for kept_before in earlier] or (
        is_labelled and kept_text.name in names
    ):
        raise DuplicateNameError(
            "kept twice",
            where="keep",
            given=kept_text.text,
            allowed="each thing once, under a name of its own",
        )
    base = f"{kept_text.name}_value" if _is_taken(kept_text.name) else kept_text.name
    name, number = base, 1
    while name in names:
        number += 1
        name = f"{base}_{number}"
    return replace(kept_text, name=name)
