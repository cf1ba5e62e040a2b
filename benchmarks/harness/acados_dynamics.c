/* One sample of the states (q, q', sums z, deviation d of the inputs from those of the motion) with derivatives, for
 * acados' discrete dynamics: Runge-Kutta steps of order four of the accelerations, by CasADi's `accelerations`. Before this text
 * stand the sizes NQ, NU, NZ, SUBSTEPS, the matrix SUM_OUTPUT (NZ, 2 NQ) and the sample SAMPLE [s].
 * WITH_MOVE: whether the deviation changes at the start of the sample. VALUE, VALUE_AND_JACOBIAN: names of the functions.
 * Parameters: inputs of the motion, its state. */
#include <string.h>

#include "acados/utils/external_function_generic.h"
#include "blasfeo_d_aux.h"

int accelerations(const double **arg, double **res, long long int *iw, double *w, int mem);

enum { NX = 2 * NQ, NC = NX + NU, NS = NX + NZ + NU, NM = WITH_MOVE ? NU : 0, NR = NM + NS };

/* Rate of a state, and of its derivatives by the state and the inputs at the start of the sample. */
static void find_rate(const double *x, const double *u, const double (*s)[NC], double *rate, double (*by)[NC])
{
  static double jq[NQ * NQ], jv[NQ * NQ], ju[NQ * NU], w[SZ_W + 1];
  static long long int iw[SZ_IW + 1];
  const double *arg[SZ_ARG] = {x, x + NQ, u};
  double *res[SZ_RES] = {rate + NQ, jq, jv, ju};
  int i, j, k;
  memcpy(rate, x + NQ, NQ * sizeof *rate);
  accelerations(arg, res, iw, w, 0);
  memcpy(by, s + NQ, sizeof *by * NQ);
  for (i = 0; i < NQ; ++i) {
    double *sum = by[NQ + i];
    for (j = 0; j < NC; ++j) {
      sum[j] = j < NX ? 0.0 : ju[(j - NX) * NQ + i];
    }
    for (k = 0; k < NQ; ++k) {
      const double a = jq[k * NQ + i], b = jv[k * NQ + i];
      for (j = 0; j < NC; ++j) {
        sum[j] += a * s[k][j] + b * s[NQ + k][j];
      }
    }
  }
}

/* Move a state x over a sample, and its derivatives s. */
static void advance(double *x, const double *u, double (*s)[NC])
{
  static const double SHARE[4] = {0.0, 0.5, 0.5, 1.0}, PART[4] = {1.0, 2.0, 2.0, 1.0};
  static double rate[NX], by[NX][NC], stage[NX], stage_by[NX][NC], sum[NX], sum_by[NX][NC];
  const double step = SAMPLE / SUBSTEPS;
  int i, j, k, n;
  for (n = 0; n < SUBSTEPS; ++n) {
    memset(sum, 0, sizeof sum);
    memset(sum_by, 0, sizeof sum_by);
    memset(rate, 0, sizeof rate);
    memset(by, 0, sizeof by);
    for (k = 0; k < 4; ++k) {
      for (i = 0; i < NX; ++i) {
        stage[i] = x[i] + SHARE[k] * step * rate[i];
        for (j = 0; j < NC; ++j) {
          stage_by[i][j] = s[i][j] + SHARE[k] * step * by[i][j];
        }
      }
      find_rate(stage, u, (const double(*)[NC])stage_by, rate, by);
      for (i = 0; i < NX; ++i) {
        sum[i] += PART[k] * rate[i];
        for (j = 0; j < NC; ++j) {
          sum_by[i][j] += PART[k] * by[i][j];
        }
      }
    }
    for (i = 0; i < NX; ++i) {
      x[i] += step / 6.0 * sum[i];
      for (j = 0; j < NC; ++j) {
        s[i][j] += step / 6.0 * sum_by[i][j];
      }
    }
  }
}

static void sample_dynamics(void **in, void **out, const double *p, int with_derivatives)
{
  struct blasfeo_dvec_args *f = out[0], *x_in = in[0], *u_in = in[1];
  static double state[NS], move[NU + 1], x[NX], u[NU], s[NX][NC], jac[NS][NR];
  int i, j;
  blasfeo_unpack_dvec(NS, x_in->x, x_in->xi, state, 1);
  blasfeo_unpack_dvec(NM, u_in->x, u_in->xi, move, 1);
  memcpy(x, state, sizeof x);
  memset(s, 0, sizeof s);
  for (i = 0; i < NX; ++i) {
    s[i][i] = 1.0;
  }
  for (i = 0; i < NU; ++i) {
    state[NX + NZ + i] += WITH_MOVE ? move[i] : 0.0;
    u[i] = p[i] + state[NX + NZ + i];
  }
  for (i = 0; i < NZ; ++i) {
    for (j = 0; j < NX; ++j) {
      state[NX + i] += SUM_OUTPUT[i][j] * (x[j] - p[NU + j]);
    }
  }
  advance(x, u, s);
  memcpy(state, x, sizeof x);
  blasfeo_pack_dvec(NS, state, 1, f->x, f->xi);
  if (!with_derivatives) {
    return;
  }
  memset(jac, 0, sizeof jac);
  for (i = 0; i < NX; ++i) {
    memcpy(jac[i] + NM, s[i], NX * sizeof(double));
    memcpy(jac[i] + NM + NX + NZ, s[i] + NX, NU * sizeof(double));
    memcpy(jac[i], s[i] + NX, NM * sizeof(double));
  }
  for (i = 0; i < NZ; ++i) {
    memcpy(jac[NX + i] + NM, SUM_OUTPUT[i], NX * sizeof(double));
    jac[NX + i][NM + NX + i] = 1.0;
  }
  for (i = 0; i < NU; ++i) {
    jac[NX + NZ + i][NM + NX + NZ + i] = 1.0;
    if (WITH_MOVE) {
      jac[NX + NZ + i][i] = 1.0;
    }
  }
  struct blasfeo_dmat_args *to = out[1];
  blasfeo_pack_dmat(NR, NS, jac[0], NR, to->A, to->ai, to->aj);
}

int VALUE(void **in, void **out, void *p)
{
  sample_dynamics(in, out, p, 0);
  return 0;
}

int VALUE_AND_JACOBIAN(void **in, void **out, void *p)
{
  sample_dynamics(in, out, p, 1);
  return 0;
}
