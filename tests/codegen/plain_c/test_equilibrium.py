"""The solver for equilibria in plain C, against a chain of springs whose equilibria are known."""

from pathlib import Path

import numpy as np
import pytest

from tests.cases import thorough
from tests.codegen.plain_c.alone import options_for, run_c

HEAD = """
#include <stdio.h>
#include <stdlib.h>
#include "follow_equilibria.h"
"""

FACTOR = """
int main(void)
{
  /* [4 2 0; 2 5 1; 0 1 3], and the same with -3 in its last place. */
  static const int row[7] = {0, 1, 0, 1, 2, 1, 2}, start[4] = {0, 2, 5, 7};
  static const double good[7] = {4, 2, 2, 5, 1, 1, 3}, bad[7] = {4, 2, 2, 5, 1, 1, -3};
  static const double force[3] = {8, 15, 11};
  double weight[3], factor[9], step[3], pivot;
  const double nan_at_end[3] = {1, -7, NAN};
  int is_definite;
  cholesky_fill(good, row, start, 0.0, force, factor);
  is_definite = cholesky_factor(3, factor, &pivot);
  cholesky_solve(3, factor, force, step);
  printf("%d %.17g %.17g %.17g %.17g\\n", is_definite, pivot, step[0], step[1], step[2]);
  cholesky_fill(bad, row, start, 0.0, force, factor);
  is_definite = cholesky_factor(3, factor, &pivot);
  printf("%d %.17g\\n", is_definite, pivot);
  cholesky_weight(bad, row, start, weight);
  cholesky_fill(bad, row, start, 4.0, weight, factor);
  is_definite = cholesky_factor(3, factor, &pivot);
  printf("%g %g %g %d\\n", weight[0], weight[1], weight[2], is_definite);
  printf("%g %d\\n", largest_entry(force), largest_entry(nan_at_end) == largest_entry(nan_at_end));
  return 0;
}
"""


def test_factors_solve_and_find_what_is_not_definite(tmp_path: Path) -> None:
    lines = run_c(HEAD + FACTOR, tmp_path, *options_for(3, False)).splitlines()
    matrix = np.array([[4.0, 2.0, 0.0], [2.0, 5.0, 1.0], [0.0, 1.0, 3.0]])
    is_definite, pivot, *step = map(float, lines[0].split())
    assert is_definite == 1
    assert pivot == pytest.approx(3 - 1 / 4)
    assert step == pytest.approx(np.linalg.solve(matrix, [8, 15, 11]).tolist())
    assert lines[1].split()[0] == "0"
    assert float(lines[1].split()[1]) == pytest.approx(-3 - 1 / 4)
    assert lines[2] == "4 5 3 1"
    assert lines[3] == "15 0"


FIND = """
int main(void)
{
  static equilibrium_path_memory m;
  static double force[3 * N], coordinate[3 * N], start[N];
  static scene_equilibrium_report report[3];
  equilibrium_arguments arguments;
  long long n_found = 0;
  int k, status;
  arguments.varied = force;
  for (k = 0; k < N; ++k) {
    start[k] = 0.5 * k;
    force[k] = 0.25;
    force[N + k] = -0.125 * k;
    force[2 * N + k] = k == 0 ? BAD : 0.0;
  }
  status = equilibrium_follow(start, 3, &arguments, 1, 1e-9, 50, coordinate, report, &n_found, &m);
  printf("%d %d\\n", status, (int)n_found);
  for (k = 0; k < 3 * N; ++k) {
    printf("%.17g\\n", coordinate[k]);
  }
  printf("%d\\n", equilibrium_find(start, &arguments, 1, -1.0, 50, report, &m.newton));
  printf("%d\\n", equilibrium_find(start, &arguments, 0, 1e-9, 50, report, &m.newton));
  printf("%d\\n", equilibrium_find(start, &arguments, 1, 1e-9, 0, report, &m.newton));
  return 0;
}
"""


def chain(force: np.ndarray) -> np.ndarray:
    """Places of nodes on springs of length 1 and stiffness 1 in a row, from the left."""
    tension = np.cumsum(force[::-1])[::-1]
    return np.cumsum(1 + tension)


@pytest.mark.parametrize("n", [15, *thorough(1, 40)])
def test_a_chain_of_springs_settles_where_statics_says(n: int, tmp_path: Path) -> None:
    printed = run_c(HEAD + FIND.replace("BAD", "0.0"), tmp_path, *options_for(n, False)).split()
    assert printed[:2] == ["0", "3"]
    found = np.array(printed[2 : 2 + 3 * n], dtype=float).reshape(3, n)
    forces = np.array([np.full(n, 0.25), -0.125 * np.arange(n), np.zeros(n)])
    np.testing.assert_allclose(found, [chain(force) for force in forces], rtol=1e-9, atol=1e-8)
    assert printed[2 + 3 * n :] == ["3", "1", "8"]  # invalid argument, not finite, not converged


def test_a_path_ends_where_its_force_is_not_finite(tmp_path: Path) -> None:
    printed = run_c(HEAD + FIND.replace("BAD", "NAN"), tmp_path, *options_for(4, False)).split()
    assert printed[:2] == ["1", "2"]
    found = np.array(printed[2:14], dtype=float).reshape(3, 4)
    assert np.isfinite(found[:2]).all()
    assert np.isnan(found[2]).all()
