"""Events of load paths in tables: which of many are shown."""

import numpy as np

from tensegrity_codegen.report.result_tables import describe_excess, events_table, find_first_events
from tensegrity_codegen.runtime.paths.load_path import PathEvent


def make(kind: str, *names: str, at: float) -> PathEvent:
    return PathEvent(kind, names, at, np.zeros(1), np.zeros(2), 0)


def test_the_first_event_of_each_kind_and_limit_is_shown() -> None:
    events = [make("slack", f"c{k}", at=0.1 * k) for k in range(40)]
    events += [make("exceeded", "b1 (buckling)", at=5.0), make("exceeded", "b2 (buckling)", at=6.0)]
    events += [make("exceeded", "c1 (yield_stress)", "b3 (buckling)", at=7.0), make("limit", at=8.0)]
    assert find_first_events(events) == [0, 40, 42, 43]
    assert events_table(events).pick(6) == [0, 40, 42, 43, 1, 2]
    assert describe_excess(events, 4) == ["b1 (buckling) first exceeded at load factor 5"]
    assert describe_excess(events[:40], 4) == []
