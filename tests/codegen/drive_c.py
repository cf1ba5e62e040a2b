"""A C program that calls every generated function with good, bad and missing values."""

import re

from tensegrity_codegen.tables.manifest import STATUS, FunctionSpec, IntegratorSpec, Manifest
from tensegrity_codegen.tables.precision import find_precision

VALUES = {
    "double": ("NAN", "INFINITY", "-INFINITY", "0.0", "1e308", "-1e308", "5e-324"),
    "single": ("NAN", "INFINITY", "-INFINITY", "0.0f", "3e38f", "-3e38f", "1e-45f"),
}
# End, rtol, atol, most steps and number of samples of runs with error control, good and bad.
TOLERANCES = (
    ("2e-3", "1e-6", "1e-9", "1000", "3"),
    ("2e-3", "1e-6", "1e-9", "3", "3"),
    ("2e-3", "1e-300", "1e-300", "1000", "0"),
    ("1e-300", "1e-6", "1e-9", "1000", "3"),
    ("1e300", "1e-6", "1e-9", "1000", "3"),
    ("0.0", "1e-6", "1e-9", "1000", "3"),
    ("NAN", "1e-6", "1e-9", "1000", "3"),
    ("2e-3", "-1.0", "1e-9", "1000", "3"),
    ("2e-3", "1e-6", "INFINITY", "-1", "3"),
)
STEPS = (
    # time_start, step, first_step, n_steps, n_samples
    ("0.0", "1e-4", "0", "50", "3"),
    ("0.0", "1e-4", "0", "0", "0"),
    ("0.0", "1e300", "0", "3", "3"),
    ("0.0", "1e-300", "0", "3", "3"),
    ("1e308", "1e308", "3", "2", "3"),
    ("0.0", "1e-4", "LLONG_MAX", "2", "3"),
    ("0.0", "1e-4", "-1", "2", "3"),
    ("0.0", "1e-4", "0", "LLONG_MIN", "3"),
    ("0.0", "0.0", "0", "2", "3"),
    ("NAN", "1e-4", "0", "2", "3"),
    ("0.0", "NAN", "0", "2", "3"),
    ("0.0", "INFINITY", "0", "2", "LLONG_MIN"),
)


def format_driver(manifest: Manifest, source: str) -> str:
    """Return the program's text; it ends with 0 unless a status is outside the table. source: scene.c."""
    largest = max(len(item.nominal) for item in manifest.arguments)
    body = [_function_calls(manifest, spec) for spec in manifest.functions]
    body += [_reset(manifest)] if manifest.integrators else []
    body += [_integrator_calls(manifest, spec) for spec in manifest.integrators]
    externals = find_externals(source)
    body += [EXTERNAL, *(f"EXTERNAL({name})" for name in externals)] if externals else []
    return "\n".join(
        [
            *(f"#include <{name}.h>" for name in ("limits", "math", "stddef", "stdio", "stdlib", "string")),
            f'#include "{manifest.name}.h"',
            f"enum {{ LARGEST = {largest} }};",
            f"typedef {find_precision(manifest.precision).c_type} real;",
            "static const real bad[] = {" + ", ".join(VALUES[manifest.precision]) + "};",
            "static int worst = 0;",
            f"enum {{ LAST_STATUS = {len(STATUS) - 1} }};",
            "static void note(int status) { if (status < 0 || status > LAST_STATUS) { worst = 1; } }",
            *body,
            "int main(void)\n{",
            *(f"  call_{spec.quantity}();" for spec in manifest.functions),
            *(f"  external_{name}();" for name in externals),
            *(f"  integrate_{spec.name}();" for spec in manifest.integrators),
            '  puts(worst ? "bad status" : "done");\n  return worst;\n}\n',
        ]
    )


def _size(manifest: Manifest, spec: FunctionSpec) -> int:
    if spec.pattern is not None:
        return len(spec.pattern.row)
    size = 1
    for length in spec.shape:
        size *= length
    return size


def _function_calls(manifest: Manifest, spec: FunctionSpec) -> str:
    nominal = [f"{manifest.name}_nominal_{name}" for name in spec.arguments]
    calls = [f"note({spec.symbol}({', '.join([*nominal, 'out'])}));"]
    calls += [f"note({spec.symbol}({', '.join([*nominal, 'NULL'])}));"]
    for place in range(len(nominal)):
        others = [*nominal[:place], "NULL", *nominal[place + 1 :]]
        calls.append(f"note({spec.symbol}({', '.join([*others, 'out'])}));")
    whole = [f"note({spec.symbol}({', '.join(['value'] * len(nominal) + ['out'])}));"] if nominal else []
    return _with_bad_values(f"call_{spec.quantity}", f"real out[{_size(manifest, spec)}];", calls, whole)


def _with_bad_values(name: str, declarations: str, calls: list[str], whole: list[str]) -> str:
    """A function that makes the calls, then `whole` with `value` filled with each bad value."""
    lines = [f"static void {name}(void)\n{{", f"  {declarations}", "  real value[LARGEST];"]
    lines += ["  size_t k, i;", *(f"  {call}" for call in calls)]
    lines += ["  for (k = 0; k < sizeof bad / sizeof bad[0]; ++k) {"]
    lines += ["    for (i = 0; i < LARGEST; ++i) { value[i] = bad[k]; }"]
    return "\n".join([*lines, "    (void)value;", *(f"    {call}" for call in whole), "  }\n}"])


def _reset(manifest: Manifest) -> str:
    n = len(manifest.coordinate_name)
    return (
        "static void reset(real *state, long long *sampled)\n{\n  int i;\n  *sampled = 0;\n"
        f"  for (i = 0; i < {n}; ++i) {{\n    state[i] = {manifest.name}_nominal_coordinate[i];\n"
        f"    state[{n} + i] = {manifest.name}_nominal_velocity[i];\n  }}\n}}\n"
    )


def _integrator_calls(manifest: Manifest, spec: IntegratorSpec) -> str:
    n_states = 2 * len(manifest.coordinate_name)
    nominal = [f"{manifest.name}_nominal_{name}" for name in spec.arguments]

    tensions = ["tensions"] if spec.name == "radau" else []

    def call(values: tuple[str, ...], passed: list[str], state: str = "state", work: str = "work") -> str:
        *head, samples = values
        if spec.name == "rk4":
            before, after, ready = [*head, state], ["&done"], ""
        else:
            before, after = [*head, "&time", "&step", state], ["&done", "&rejected"]
            ready = "time = 0.0; step = 0.0; "
        if spec.name == "radau":
            after, ready = ["count", "vibration"], ready + "memset(count, 0, sizeof count); "
        sampled = ["times", "samples", *tensions, "&sampled"]
        given = ", ".join([*before, *passed, samples, *sampled, *after, work])
        return f"reset(state, &sampled); {ready}note({spec.symbol}({given}));"

    runs = STEPS if spec.name == "rk4" else TOLERANCES
    if spec.name == "radau":  # steps are long under sanitizers
        runs = tuple((*row[:3], row[3].replace("1000", "20"), row[4]) for row in runs)
    calls = [call(values, nominal) for values in runs]
    calls += [call(runs[0], nominal, state="NULL"), call(runs[0], nominal, work="NULL")]
    for place in range(len(nominal)):
        calls.append(call(runs[0], [*nominal[:place], "NULL", *nominal[place + 1 :]]))
    declarations = (
        "static const double times[3] = {0.0, 1e-4, 2e-3};\n  double time = 0.0, step = 0.0;\n"
        f"  real state[{n_states}], samples[{3 * n_states}], work[{spec.work_size}];\n"
        "  long long sampled, done, rejected = 0;\n  (void)time; (void)step; (void)rejected;"
    )
    if spec.name == "radau":
        size = f"{manifest.name.upper()}_RADAU_N_TENSIONS"
        declarations += f"\n  long long count[6];\n  double vibration[3], tensions[3 * {size}];"
    whole = [call(runs[0], ["value"] * len(nominal))]
    return _with_bad_values(f"integrate_{spec.name}", declarations, calls, whole)


# Calls as CasADi makes them: no more work memory than asked for, NULL for zeros and for no result.
EXTERNAL = """
static size_t count_entries(const long long *pattern)
{
  const long long rows = pattern[0], columns = pattern[1];
  return (size_t)(pattern[2] == 1 ? rows * columns : pattern[2 + columns]);
}
#define EXTERNAL(f) \\
int f(const double **arg, double **res, long long *iw, double *w, int mem); \\
int f##_checkout(void); \\
void f##_release(int mem); \\
long long f##_n_in(void); \\
long long f##_n_out(void); \\
const char *f##_name_in(long long i); \\
const char *f##_name_out(long long i); \\
const long long *f##_sparsity_in(long long i); \\
const long long *f##_sparsity_out(long long i); \\
int f##_work(long long *sz_arg, long long *sz_res, long long *sz_iw, long long *sz_w); \\
static void external_##f(void) \\
{ \\
  long long n_arg, n_res, n_iw, n_w, i; \\
  const double **arg; \\
  double **res, *w; \\
  f##_work(&n_arg, &n_res, &n_iw, &n_w); \\
  arg = (const double **)calloc((size_t)n_arg + 1, sizeof *arg); \\
  res = (double **)calloc((size_t)n_res + 1, sizeof *res); \\
  w = (double *)malloc((size_t)(n_w + 1) * sizeof(double)); \\
  note(f(arg, res, NULL, w, f##_checkout())); \\
  for (i = f##_n_out() - 1; i >= 0; --i) { \\
    res[i] = (double *)malloc((count_entries(f##_sparsity_out(i)) + 1) * sizeof(double)); \\
    note(f(arg, res, NULL, w, 0)); \\
  } \\
  f##_release(0); \\
  for (i = -1; i <= f##_n_in(); ++i) { \\
    if ((f##_name_in(i) == NULL) != (f##_sparsity_in(i) == NULL)) { worst = 1; } \\
  } \\
  if (f##_name_out(f##_n_out()) != NULL || f##_sparsity_out(f##_n_out()) != NULL) { worst = 1; } \\
  for (i = 0; i < n_res; ++i) { free(res[i]); } \\
  free(w); free(res); free((void *)arg); \\
}
"""
DECLARED = re.compile(r"^\w+_API casadi_int (\w+)_n_in\(void\);", re.MULTILINE)


def find_externals(source: str) -> list[str]:
    """Return the names of CasADi's functions in a C source."""
    return DECLARED.findall(source)
