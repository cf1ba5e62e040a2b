#ifndef RODAS_H
#define RODAS_H
#include "finite.h"
#include "sample.h"

/* RODAS5P of G. Steinebach, BIT Numerical Mathematics 63 (2023) 27, for x' = f(t, x), x = (q, v), J its Jacobian at the
 * start of the step. Stage i solves
 *   (1 / (h gamma) - J) u_i = f(t + c_i h, x + sum_j a_ij u_j) + sum_j C_ij u_j / h + h d_i df/dt,
 * and the step ends at the state of stage 7 plus u_7: its error estimate. With q' = v one system of n equations is left,
 *   (1 / (h gamma) - A_v - h gamma A_q) u_v = r_v + h gamma A_q r_q,   u_q = h gamma (r_q + u_v),
 * where A_q, A_v are the Jacobians of the acceleration and r the right-hand side; rates of internal states stand below
 * the accelerations. A pull in a live page is not in J. */
#if !WITH_FLOAT

enum {
  RODAS_SOLVED = 8,      /* systems that a step solves: stages */
  RODAS_STAGES = 9,      /* place of the derivative at the end, behind that of the start and the stages */
  RODAS_RATES = 10,      /* vectors of a state's length that are kept */
  RODAS_ERROR_ORDER = 5, /* power of the step with which the error estimate goes */
  RODAS_DENSE = 4,       /* terms of dense output */
  RODAS_DENSE_ROWS = 0,  /* evaluations that it takes */
  RODAS_EVALUATIONS = 7  /* that a trial takes; three more where arguments follow a profile */
};
static const double rodas_gamma = 0.21193756319429014;
/* Coefficients a_ij of stages 1 to 5; stage 6 begins where stage 5 ends, 7 where 6 does. */
static const double rodas_state[6][5] = {
    {0.0, 0.0, 0.0, 0.0, 0.0},
    {3.0, 0.0, 0.0, 0.0, 0.0},
    {2.849394379747939, 0.45842242204463923, 0.0, 0.0, 0.0},
    {-6.954028509809101, 2.489845061869568, -10.358996098473584, 0.0, 0.0},
    {2.8029986275628964, 0.5072464736228206, -0.3988312541770524, -0.04721187230404641, 0.0},
    {-7.502846399306121, 2.561846144803919, -11.627539656261098, -0.18268767659942256, 0.030198172008377946}};
static const double rodas_coupling[8][7] = {
    {0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0},
    {-14.155112264123755, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0},
    {-17.97296035885952, -2.859693295451294, 0.0, 0.0, 0.0, 0.0, 0.0},
    {147.12150275711716, -1.41221402718213, 71.68940251302358, 0.0, 0.0, 0.0, 0.0},
    {165.43517024871676, -0.4592823456491126, 42.90938336958603, -5.961986721573306, 0.0, 0.0, 0.0},
    {24.854864614690072, -3.0009227002832186, 47.4931110020768, 5.5814197821558125, -0.6610691825249471, 0.0, 0.0},
    {30.91273214028599, -3.1208243349937974, 77.79954646070892, 34.28646028294783, -19.097331116725623,
     -28.087943162872662, 0.0},
    {37.80277123390563, -3.2571969029072276, 112.26918849496327, 66.9347231244047, -40.06618937091002,
     -54.66780262877968, -9.48861652309627}};
static const double rodas_node[8] = {0.0, 0.6358126895828704, 0.4095798393397535, 0.9769306725060716,
                                     0.4288403609558664, 1.0, 1.0, 1.0};
static const double rodas_slope[8] = {0.21193756319429014, -0.42387512638858027, -0.3384627126235924,
                                      1.8046452872882734, 2.325825639765069, 0.0, 0.0, 0.0};
/* Terms of dense output, each a sum over the stages. */
static const double rodas_dense[3][8] = {
    {25.948786856663858, -2.5579724845846235, 10.433815404888879, -2.3679251022685204, 0.524948541321073,
     1.1241088310450404, 0.4272876194431874, -0.17202221070155493},
    {-9.91568850695171, -0.9689944594115154, 3.0438037242978453, -24.495224566215796, 20.176138334709044,
     15.98066361424651, -6.789040303419874, -6.710236069923372},
    {11.419903575922262, 2.8879645146136994, 72.92137995996029, 80.12511834622643, -52.072871366152654,
     -59.78993626266729, -0.15582684282751913, 4.883087185713722}};

/* Memory of one trial: the Jacobian, the factors of its matrix column by column, and vectors. */
typedef struct {
  double jacobian[N_STATE_JACOBIAN], matrix[N_SLOPES * N_SLOPES], side[N_SLOPES], slope[N_SLOPES], rate[N_STATES];
  int pivot[N_SLOPES];
} rodas_memory;

/* result += scale A_q x, from the lower left part of the Jacobian. */
static inline void rodas_add_stiff(const rodas_memory *w, double scale, const double *x, double *result)
{
  int j, k;
  for (j = 0; j < N; ++j) {
    for (k = scene_state_jacobian_column_start[j]; k < scene_state_jacobian_column_start[j + 1]; ++k) {
      if (scene_state_jacobian_row[k] >= N) {
        result[scene_state_jacobian_row[k] - N] += scale * w->jacobian[k] * x[j];
      }
    }
  }
}

/* The matrix of a step of length h. */
static inline void rodas_enter(double h, rodas_memory *w)
{
  const double step = h * rodas_gamma;
  int j, k;
  for (k = 0; k < N_SLOPES * N_SLOPES; ++k) {
    w->matrix[k] = 0.0;
  }
  for (j = 0; j < N_STATES; ++j) {
    const double scale = j < N ? -step : -1.0;
    for (k = scene_state_jacobian_column_start[j]; k < scene_state_jacobian_column_start[j + 1]; ++k) {
      const int row = scene_state_jacobian_row[k] - N;
      if (row >= 0) {
#if WITH_INTERNAL
        w->matrix[(j < N ? j : j - N) * N_SLOPES + row] += scale * w->jacobian[k];
#else
        w->matrix[j % N * N + row] += scale * w->jacobian[k];
#endif
      }
    }
  }
  for (k = 0; k < N_SLOPES; ++k) {
    w->matrix[k * (N_SLOPES + 1)] += 1.0 / step;
  }
}

/* y += scale x from entry `first` to before `last`. */
static inline void rodas_add(
    int first, int last, double scale, const double *TENSEGRITY_RESTRICT x, double *TENSEGRITY_RESTRICT y)
{
  int k;
  for (k = first; k < last; ++k) {
    y[k] += scale * x[k];
  }
}

/* Factors of the matrix, rows exchanged as `pivot` says; zero where it is singular or not finite. */
static inline int rodas_factor(rodas_memory *w)
{
  int j, k;
  for (j = 0; j < N_SLOPES; ++j) {
    double *own = w->matrix + j * N_SLOPES;
    double inverse;
    int best = j;
    /* Pivot: the largest entry of the column from the diagonal on. */
    for (k = j + 1; k < N_SLOPES; ++k) {
      best = fabs(own[k]) > fabs(own[best]) ? k : best;
    }
    w->pivot[j] = best;
    inverse = 1.0 / own[best];
    if (!(fabs(own[best]) > 0.0) || !(fabs(own[best]) < INFINITY)) {
      return 0;
    }
    for (k = 0; k < N_SLOPES; ++k) {
      double *column = w->matrix + k * N_SLOPES;
      const double moved = column[j];
      column[j] = column[best];
      column[best] = moved;
    }
    /* L: the column over the pivot; every column to the right: minus its entry in this row times L. */
    own[j] = inverse;
    for (k = j + 1; k < N_SLOPES; ++k) {
      own[k] *= inverse;
    }
    for (k = j + 1; k < N_SLOPES; ++k) {
      double *column = w->matrix + k * N_SLOPES;
      if (column[j] != 0.0) {
        rodas_add(j + 1, N_SLOPES, -column[j], own, column);
      }
    }
  }
  return 1;
}

/* Solve with the factors, in place. */
static inline void rodas_solve(const rodas_memory *w, double *x)
{
  int j;
  for (j = 0; j < N_SLOPES; ++j) {
    const double moved = x[j];
    x[j] = x[w->pivot[j]];
    x[w->pivot[j]] = moved;
  }
  for (j = 0; j < N_SLOPES; ++j) {
    rodas_add(j + 1, N_SLOPES, -x[j], w->matrix + j * N_SLOPES, x);
  }
  for (j = N_SLOPES - 1; j >= 0; --j) {
    x[j] *= w->matrix[j * (N_SLOPES + 1)];
    rodas_add(0, j, -x[j], w->matrix + j * N_SLOPES, x);
  }
}

#if WITH_PROFILE
/* Derivative of the accelerations to time where arguments follow a profile: a difference of third order over a small
 * part of the step, within which values are smooth. */
static inline void rodas_find_slope(
    double h, const double *state, const motion_arguments *with, const double *rate, rodas_memory *w)
{
  static const double weight[4] = {-11.0 / 6.0, 3.0, -1.5, 1.0 / 3.0};
  const double apart = h / 64.0;
  int i, k;
  for (k = 0; k < N_SLOPES; ++k) {
    w->slope[k] = with->profile == NULL ? 0.0 : weight[0] * rate[N + k] / apart;
  }
  for (i = 1; i < 4 && with->profile != NULL; ++i) {
    profile_set_stage(i * apart, with->profile);
    motion_rate(state, with, w->rate);
    for (k = 0; k < N_SLOPES; ++k) {
      w->slope[k] += weight[i] * w->rate[N + k] / apart;
    }
  }
}
#endif

/* Try a step: rates[0] is the derivative at `state`; fills rates[1..8] by the stages, the change of the state and
 * `trial`, and returns the scaled error. `lost` is what rounding has taken from the state so far (Kahan 1965). */
static inline double rodas_try(
    double h, double rtol, double atol, const double *state, const motion_arguments *with, const double *lost,
    double *TENSEGRITY_RESTRICT rates, double *TENSEGRITY_RESTRICT change, double *TENSEGRITY_RESTRICT trial,
    rodas_memory *w)
{
  const double *last = rates + N_STATES * RODAS_SOLVED;
  const double step = h * rodas_gamma;
  double worst = 0.0;
  int i, j, k;
#if WITH_PROFILE
  profile_set_stage(0.0, with->profile);
#endif
  motion_state_jacobian(state, state + N, with, w->jacobian);
  rodas_enter(h, w);
  if (!rodas_factor(w)) {
    return INFINITY;
  }
#if WITH_PROFILE
  rodas_find_slope(h, state, with, rates, w);
#endif
  for (i = 0; i < RODAS_SOLVED; ++i) {
    double *own = rates + N_STATES * (i + 1);
    const double *rate = i == 0 ? rates : w->rate;
    /* The state of the stage, and its derivative */
    for (k = 0; k < N_STATES && i <= 5; ++k) {
      change[k] = lost[k];
    }
    for (j = i > 5 ? i - 1 : 0; j < i; ++j) {
      rodas_add(0, N_STATES, i > 5 ? 1.0 : rodas_state[i][j], rates + N_STATES * (j + 1), change);
    }
    if (i > 0) {
      for (k = 0; k < N_STATES; ++k) {
        trial[k] = state[k] + change[k];
      }
#if WITH_PROFILE
      profile_set_stage(rodas_node[i] * h, with->profile);
#endif
      motion_rate(trial, with, w->rate);
    }
    /* The right-hand side: of coordinates to `own`, of velocities to `side` */
    for (k = 0; k < N_STATES; ++k) {
      own[k] = rate[k];
    }
    for (j = 0; j < i; ++j) {
      rodas_add(0, N_STATES, rodas_coupling[i][j] / h, rates + N_STATES * (j + 1), own);
    }
    for (k = 0; k < N_SLOPES; ++k) {
      w->side[k] = own[N + k];
#if WITH_PROFILE
      w->side[k] += h * rodas_slope[i] * w->slope[k];
#endif
    }
    rodas_add_stiff(w, step, own, w->side);
    rodas_solve(w, w->side);
    for (k = 0; k < N; ++k) {
      own[k] = step * (own[k] + w->side[k]);
      own[N + k] = w->side[k];
    }
#if WITH_INTERNAL
    for (k = N; k < N_SLOPES; ++k) {
      own[N + k] = w->side[k];
    }
#endif
  }
  for (k = 0; k < N_STATES; ++k) {
    change[k] += last[k];
    trial[k] = state[k] + change[k];
    worst = fmax(worst, fabs(last[k]) / (atol + rtol * fmax(fabs(state[k]), fabs(trial[k]))));
  }
  return all_finite(trial, N_STATES) ? worst : INFINITY;
}

/* Make ready for dense output in the step from `old` to `trial`; fills dense. */
static inline void rodas_prepare(
    double h, const double *old, const motion_arguments *with, const double *trial, double *spare,
    double *TENSEGRITY_RESTRICT rates, double *TENSEGRITY_RESTRICT dense)
{
  int i, k;
  (void)h;
  (void)with;
  (void)spare;
  for (k = 0; k < N_STATES; ++k) {
    double term[3] = {0.0, 0.0, 0.0};
    for (i = 0; i < RODAS_SOLVED; ++i) {
      const double stage = rates[N_STATES * (i + 1) + k];
      term[0] += rodas_dense[0][i] * stage;
      term[1] += rodas_dense[1][i] * stage;
      term[2] += rodas_dense[2][i] * stage;
    }
    dense[k] = trial[k] - old[k];
    dense[N_STATES + k] = term[0];
    dense[2 * N_STATES + k] = term[1] + term[2];
    dense[3 * N_STATES + k] = -term[2];
  }
}

#endif
#endif
