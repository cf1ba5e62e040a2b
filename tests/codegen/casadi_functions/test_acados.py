"""External functions for acados: its function pointers take them, and their derivatives are right."""

from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from tensegrity_codegen.codegen.casadi_functions import build_acados
from tensegrity_codegen.codegen.compilation.toolchain import find_compiler
from tensegrity_codegen.codegen.emit import emit
from tensegrity_codegen.symbolic.build import build_model
from tensegrity_codegen.system.errors import InvalidValueError
from tensegrity_codegen.tables.request import ModelRequest
from tests.codegen.build_c import STRICT, run, write_files
from tests.codegen.subjects import everything
from tests.ground_cases import make_belt
from tests.models import load

NAMES = (
    *("expl_ode_fun", "expl_vde_forw", "expl_vde_adj", "impl_dae_fun", "impl_dae_fun_jac_x_xdot_z"),
    *("impl_dae_fun_jac_x_xdot_u_z", "impl_dae_fun_jac_x_xdot_u", "impl_dae_jac_x_xdot_u_z"),
)

# The members of acados' struct of an external function that templates fill, with their types.
CALLER = """
#include <stdio.h>
#include <stdlib.h>
typedef struct {
  int (*casadi_fun)(const double **, double **, int *, double *, void *);
  int (*casadi_work)(int *, int *, int *, int *);
  const int *(*casadi_sparsity_in)(int);
  const int *(*casadi_sparsity_out)(int);
  int (*casadi_n_in)(void);
  int (*casadi_n_out)(void);
} external_function;
static int size(const int *pattern)
{
  return pattern[2] == 1 ? pattern[0] * pattern[1] : pattern[2 + pattern[1]];
}
static void call(const char *title, const external_function *f)
{
  int n_arg, n_res, n_iw, n_w, i, k;
  const double **arg;
  double **res, *w;
  int *iw;
  f->casadi_work(&n_arg, &n_res, &n_iw, &n_w);
  arg = (const double **)calloc((size_t)n_arg + 1, sizeof *arg);
  res = (double **)calloc((size_t)n_res + 1, sizeof *res);
  iw = (int *)calloc((size_t)n_iw + 1, sizeof *iw);
  w = (double *)calloc((size_t)n_w + 1, sizeof *w);
  for (i = 0; i < f->casadi_n_in(); ++i) {
    const int count = size(f->casadi_sparsity_in(i));
    double *values = (double *)calloc((size_t)count + 1, sizeof *values);
    for (k = 0; k < count; ++k) {
      values[k] = 0.2 + 0.01 * ((7 * i + 3 * k) % 31);
    }
    arg[i] = values;
  }
  for (i = 0; i < f->casadi_n_out(); ++i) {
    res[i] = (double *)calloc((size_t)size(f->casadi_sparsity_out(i)) + 1, sizeof **res);
  }
  printf("%s %d\\n", title, f->casadi_fun(arg, res, iw, w, NULL));
  for (i = 0; i < f->casadi_n_out(); ++i) {
    for (k = 0; k < size(f->casadi_sparsity_out(i)); ++k) {
      printf("%d %.17g\\n", i, res[i][k]);
    }
    free(res[i]);
  }
  for (i = 0; i < f->casadi_n_in(); ++i) {
    free((void *)arg[i]);
  }
  free((void *)arg);
  free(res);
  free(iw);
  free(w);
}
"""


def subject() -> tuple[object, ModelRequest]:
    structure, request = everything()
    return structure, replace(request.wanting("acceleration"), interfaces=("acados",))


def write_caller(scene: str) -> str:
    text, calls = CALLER, ""
    for name in NAMES:
        f = f"{scene}_{name}"
        text += (
            f"int {f}(const double **, double **, int *, double *, void *);\n"
            f"int {f}_work(int *, int *, int *, int *);\n"
            f"const int *{f}_sparsity_in(int);\nconst int *{f}_sparsity_out(int);\n"
            f"int {f}_n_in(void);\nint {f}_n_out(void);\n"
        )
        fields = [f, *(f"{f}_{what}" for what in ("work", "sparsity_in", "sparsity_out", "n_in", "n_out"))]
        calls += f'  {{ const external_function f = {{{", ".join(fields)}}}; call("{name}", &f); }}\n'
    return text + "int main(void)\n{\n" + calls + "  return 0;\n}\n"


def fill(sparsity: ca.Sparsity, i: int) -> ca.DM:
    values = [0.2 + 0.01 * ((7 * i + 3 * k) % 31) for k in range(sparsity.nnz())]
    return ca.DM(sparsity, values)


@pytest.mark.thorough
def test_the_function_pointers_of_acados_take_them(tmp_path: Path) -> None:
    structure, request = subject()
    files = emit(structure, request).files  # type: ignore[arg-type]
    folder = write_files(tmp_path / "source", {**files, "caller.c": write_caller("braced")})
    compiler = find_compiler()
    units = ["braced.c", "caller.c"]
    run([*compiler.command, "-std=c99", *STRICT, *units, "-O0", "-o", "caller", "-lm"], folder, compiler)
    printed: dict[str, list[list[float]]] = {}
    for line in run([str(folder / "caller")], folder).stdout.splitlines():
        first, second = line.split()
        if first in NAMES:
            assert second == "0"
            rows = printed.setdefault(first, [])
        else:
            rows += [[] for _ in range(int(first) + 1 - len(rows))]
            rows[int(first)].append(float(second))
    made = {item.name: item.function for item in build_acados(build_model(structure, request))}  # type: ignore[arg-type]
    assert tuple(made) == NAMES
    for name, function in made.items():
        expected = function.call([fill(function.sparsity_in(k), k) for k in range(function.n_in())])
        for k, values in enumerate(printed[name]):
            right = np.array(expected[k].nonzeros())
            scale = max(1.0, np.abs(right).max(initial=0.0))
            np.testing.assert_allclose(values, right, rtol=1e-9, atol=1e-11 * scale, err_msg=f"{name} {k}")


def test_derivatives_are_those_of_the_equations_of_motion() -> None:
    structure, request = subject()
    made = {item.name: item.function for item in build_acados(build_model(structure, request))}  # type: ignore[arg-type]
    x, s_x, s_u, u, p = (fill(made["expl_vde_forw"].sparsity_in(k), k) for k in range(5))
    f, by_x, by_u = made["expl_vde_forw"](x, s_x, s_u, u, p)
    ode = made["expl_ode_fun"]
    jacobian = ode.jacobian()(x, u, p, f)
    np.testing.assert_allclose(np.array(by_x), np.array(jacobian[0] @ s_x), rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(
        np.array(by_u), np.array(jacobian[1] + jacobian[0] @ s_u), rtol=1e-9, atol=1e-6
    )
    seed = ca.DM(np.arange(1.0, 1.0 + x.numel()))
    adjoint = made["expl_vde_adj"](x, seed, u, p)
    expected = ca.horzcat(jacobian[0], jacobian[1]).T @ seed
    np.testing.assert_allclose(np.array(adjoint), np.array(expected), rtol=1e-9, atol=1e-6)
    zero = made["impl_dae_fun"](x, f, u, ca.DM(0, 1), ca.DM(0, 1), p)
    assert np.abs(np.array(zero)).max() == 0.0


def test_states_on_the_ground_have_the_bristles_of_contacts() -> None:
    request = ModelRequest(("acceleration",), parameters={"ground": (2,)}, interfaces=("acados",))
    belt = make_belt(0.2)
    made = {item.name: item.function for item in build_acados(build_model(belt, request))}
    x, p = ca.DM([0.01, 0.1, 2e-4, -1e-4]), ca.DM([0.3])
    model = load(belt, "state_derivative", parameters={"ground": (2,)})
    expected = model.compute(
        "state_derivative", coordinate=[0.01], velocity=[0.1], internal=[2e-4, -1e-4], ground=[0.3]
    )
    np.testing.assert_allclose(
        np.array(made["expl_ode_fun"](x, ca.DM(0, 1), p)).ravel(), expected, rtol=1e-14
    )
    assert made["impl_dae_fun"].size1_in("xdot") == 4


def test_acados_and_casadi_need_different_integers() -> None:
    with pytest.raises(InvalidValueError, match="different integers"):
        ModelRequest((), interfaces=("casadi", "acados"))
