"""Vectors of four members in plain C, against the same in single numbers, for each width of registers."""

import platform
from pathlib import Path

import pytest

from tests.codegen.plain_c.alone import options_for, run_c

MAIN = """
#include <stdio.h>
#include <string.h>
#include "lanes.h"

static double at[16], wanted[36], found[36];

static void check(const char *what, int count)
{
  printf("%s %d\\n", what, memcmp(wanted, found, sizeof(double) * (size_t)count) == 0);
}

#if defined(TENSEGRITY_LANES)
static void check_turns(void)
{
  lanes_xyz joined[4];
  lanes_four x, y, z;
  int k;
  four_split(xyz_load(at), xyz_load(at + 3), xyz_load(at + 6), xyz_load_last(at + 9), &x, &y, &z);
  four_join_xyz(x, y, z, joined);
  for (k = 0; k < 12; ++k) {
    wanted[k] = at[k] - (k % 3 == 1 ? 2.0 : 1.0) * at[k];
  }
  memcpy(found, at, sizeof at);
  for (k = 0; k < 4; ++k) {
    xyz_subtract(found + 3 * k, joined[k]);
    xyz_subtract(found + 3 * k, XYZ_ONLY(joined[k], 2));
  }
  check("turned", 12);
  for (k = 0; k < 12; ++k) {
    wanted[k] = at[k] + at[12 + k / 3] * at[k];
  }
  memcpy(found, at, sizeof at);
  x = four_load(at + 12);
  xyz_add(found, XYZ_TIMES(x, 0, joined[0]));
  xyz_add(found + 3, XYZ_TIMES(x, 1, joined[1]));
  xyz_add(found + 6, XYZ_TIMES(x, 2, joined[2]));
  xyz_add(found + 9, XYZ_TIMES(x, 3, joined[3]));
  check("scaled", 12);
  printf("zero %d %d\\n", xyz_is_zero(xyz_of(0.0, -0.0, 0.0)), xyz_is_zero(xyz_of(0.0, 0.0, NAN)));
  printf("below %d %d\\n", pack_is_below(four_size(four_of(1.0, -2.0, 3.0, 4.0)), 11.0),
         pack_is_below(four_square(x, x, four_of(NAN, 0.0, 0.0, NAN)), 1e300));
}

static void check_columns(void)
{
  /* Entry (r, c) of the block of lane k is 100 k + 10 r + c, with r up to c: upper triangles, row by row. */
  static const int entry[3][3] = {{0, 1, 2}, {1, 3, 4}, {2, 4, 5}};
  double block[24];
  int r, c, k;
  lanes_column column[12];
  for (k = 0; k < 24; ++k) {
    block[k] = 100.0 * (k % 4) + k / 4;
  }
  for (c = 0; c < 3; ++c) {
    four_columns(block + 4 * entry[c][0], block + 4 * entry[c][1], block + 4 * entry[c][2], column + 4 * c);
  }
  for (k = 0; k < 4; ++k) {
    memset(found, 0, sizeof found);
    block_add(found, 3, column + k);
    for (c = 0; c < 3; ++c) {
      for (r = 0; r < 3; ++r) {
        wanted[3 * c + r] = 100.0 * k + entry[r][c];
      }
    }
    check("columns", 9);
  }
}
#endif

int main(void)
{
  int k;
  for (k = 0; k < 16; ++k) {
    at[k] = 1.0 / (k + 3) - 0.1 * k;
  }
#if defined(TENSEGRITY_LANES)
  check_turns();
  check_columns();
#else
  check("none", 0);
#endif
  return 0;
}
"""

EXPECTED = ["turned 1", "scaled 1", "zero 1 0", "below 1 0", *["columns 1"] * 4]


@pytest.mark.skipif(platform.machine().lower() not in ("x86_64", "amd64"), reason="registers of x86")
@pytest.mark.parametrize("registers", ["-msse2", "-mavx2"])
def test_four_members_are_the_same_as_one_by_one(registers: str, tmp_path: Path) -> None:
    if registers == "-mavx2" and "avx2" not in Path("/proc/cpuinfo").read_text(encoding="utf-8"):
        pytest.skip("this CPU has no AVX2")
    printed = run_c(MAIN, tmp_path, *options_for(1, False), registers).splitlines()
    assert printed == EXPECTED


def test_nothing_is_left_where_vectors_are_switched_off(tmp_path: Path) -> None:
    assert run_c(MAIN, tmp_path, *options_for(1, False), "-DTENSEGRITY_NO_LANES") == "none 1\n"
