#ifndef RADAU_CONSTANTS_H
#define RADAU_CONSTANTS_H
#include "settings.h"

/* Hairer and Wanner 1996, IV.5 and IV.8: nodes of Radau IIA with three stages; derivative matrix D of polynomials that
 * vanish at 0, D^2 and D 1; D = T diag(real, [re im; -im re]) T^-1; weights that carry three stages to 0. */
static const double radau_node[3] = {0.1550510257216822, 0.6449489742783178, 1.0};
static const double radau_d[3][3] = {
    {3.224744871391589, 1.1678400846904056, -0.25319726474218085},
    {-3.5678400846904057, 0.775255128608411, 1.0531972647421808},
    {5.531972647421808, -7.531972647421808, 5.0}};
static const double radau_d2[3][3] = {
    {4.831632475943927, 6.578435211201747, -0.8525169217864182},
    {-8.445101877868414, -11.498299142610593, 6.985850255119751},
    {72.37193758882431, -37.03860425549098, 15.666666666666666}};
static const double radau_d1[3] = {4.139387691339814, -1.7393876913398136, 3.0};
static const double radau_t[3][3] = {
    {0.03668472917291511, 0.01374845078363965, 0.03395823255665048},
    {0.09719526611293867, -0.10468844842656654, -0.03405692483428347},
    {0.38844991406148166, -0.044224957030740836, -0.2498049532966813}};
static const double radau_ti[3][3] = {
    {10.757419271537078, 0.8435651776439795, 1.3473460195349984},
    {4.823362775712146, -9.757680558226538, 1.9859873137983348},
    {15.874007011153374, 3.039234467327164, -2.2595779253684523}};
static const double radau_real = 3.637834252744496, radau_re = 2.6810828736277523, radau_im = 3.0504301992474105;
static const double radau_to_start[3] = {1.5580782047249224, -0.8914115380582557, 0.3333333333333333};
/* Weights of three stages in the first and second derivative of their parabola at the end of the step. */
static const double radau_slope[3] = {0.8577380332470411, -4.857738033247041, 4.0};
static const double radau_curvature[3] = {4.831632475943927, -11.498299142610593, 6.666666666666667};

/* Newton's method for the stages: most iterations; the relative tolerance below which it may leave a smaller part of it;
 * the least ratio that corrections are taken to shrink by. */
enum { RADAU_MOST_ITERATIONS = 10 };
static const double radau_share_tolerance = 1e-6, radau_least_ratio = 0.02;
/* (h omega)^2 of a member's vibration from which on a step does not resolve it; the part of the diagonal of a
 * multiplier that a row which repeats others leaves at most. */
static const double radau_resolved = 25.0, radau_least_pivot = 1e-10;

#endif
