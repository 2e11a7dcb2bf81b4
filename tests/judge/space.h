/* Bodies in space: inertia and bias forces of a chain of turning joints by Kane's equations.
 *
 * Product of exponentials: every axis, centre of mass and inertia is given in base axes where q = 0, and displaced by
 * the turns of the joints before it. Partial velocities of the centres of mass and angular ones carry the bodies'
 * forces and moments to the joints: no frames of links, no recursion of forces, no base parameters.
 *
 * Sources: Kane & Levinson 1985, Dynamics: Theory and Applications; Brockett 1984 (product of exponentials).
 */
#ifndef SPACE_H
#define SPACE_H

#include <math.h>

#include "laws.h"

static void cross(const double *a, const double *b, double *out)
{
    double x = a[1] * b[2] - a[2] * b[1], y = a[2] * b[0] - a[0] * b[2], z = a[0] * b[1] - a[1] * b[0];
    out[0] = x;
    out[1] = y;
    out[2] = z;
}

static double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void turned(double E[3][3], const double *a, double *out)
{
    for (int r = 0; r < 3; r++) out[r] = dot(E[r], a);
}

/* R = rotation by q about the unit axis u (Rodrigues). */
static void rotation(const double *u, double q, double R[3][3])
{
    double c = cos(q), s = sin(q), d = 1.0 - c;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) R[i][j] = d * u[i] * u[j] + (i == j ? c : 0.0);
    R[0][1] -= s * u[2];
    R[1][0] += s * u[2];
    R[0][2] += s * u[1];
    R[2][0] -= s * u[1];
    R[1][2] -= s * u[0];
    R[2][1] += s * u[0];
}

typedef struct {
    double mass, centre[3], inertia[3][3]; /* in base axes where q = 0; inertia about the centre */
} solid;

/* Inertia D (n, n) of n bodies, the payload's beside the last, and torque of bias and gravity forces. */
static void kane(int n, const double (*p)[PARAMETERS], const double *arm, double payload, const double *q,
                 const double *v, double D[MOST][MOST], double *bias)
{
    double E[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, t[3] = {0, 0, 0};
    double axis[MOST][3], at[MOST][3], at_rate[MOST][3], swung[MOST][3], w[3] = {0, 0, 0}, alpha[3] = {0, 0, 0};
    const double g[3] = {arm[GRAVITY_X], arm[GRAVITY_Y], arm[GRAVITY_Z]};
    for (int i = 0; i < n; i++) {
        bias[i] = 0.0;
        for (int j = 0; j < n; j++) D[i][j] = 0.0;
    }
    for (int k = 0; k < n; k++) {
        double R[3][3], before[3][3], part[3], arm_[3];
        turned(E, &p[k][AXIS_X], axis[k]);
        turned(E, &p[k][POINT_X], at[k]);
        for (int r = 0; r < 3; r++) at[k][r] += t[r], at_rate[k][r] = 0.0;
        for (int j = 0; j < k; j++) { /* the axis' point is one of the body before */
            for (int r = 0; r < 3; r++) arm_[r] = at[k][r] - at[j][r];
            cross(axis[j], arm_, part);
            for (int r = 0; r < 3; r++) at_rate[k][r] += part[r] * v[j];
        }
        cross(w, axis[k], swung[k]); /* how fast the axis turns */
        for (int r = 0; r < 3; r++) {
            alpha[r] += swung[k][r] * v[k];
            w[r] += axis[k][r] * v[k];
        }
        rotation(axis[k], q[k], R);
        for (int r = 0; r < 3; r++)
            for (int s = 0; s < 3; s++) before[r][s] = E[r][s];
        for (int r = 0; r < 3; r++) {
            arm_[r] = t[r] - at[k][r];
            for (int s = 0; s < 3; s++) E[r][s] = R[r][0] * before[0][s] + R[r][1] * before[1][s] + R[r][2] * before[2][s];
        }
        turned(R, arm_, part);
        for (int r = 0; r < 3; r++) t[r] = at[k][r] + part[r];
        for (int load = 0; load < (k == n - 1 && payload > 0.0 ? 2 : 1); load++) {
            const double *row = p[k];
            double radius = arm[PAYLOAD_RADIUS] * arm[PAYLOAD_RADIUS];
            solid b = {row[MASS],
                       {row[CENTRE_X], row[CENTRE_Y], row[CENTRE_Z]},
                       {{row[XX], row[XY], row[XZ]}, {row[XY], row[YY], row[YZ]}, {row[XZ], row[YZ], row[ZZ]}}};
            solid held = {payload,
                          {arm[PAYLOAD_X], arm[PAYLOAD_Y], arm[PAYLOAD_Z]},
                          {{payload * radius, 0, 0}, {0, payload * radius, 0}, {0, 0, payload * radius}}};
            if (load) b = held;
            double c[3], partial[MOST][3], speed[3] = {0, 0, 0}, a[3] = {-g[0], -g[1], -g[2]}, I[3][3], half[3][3];
            turned(E, b.centre, c);
            for (int r = 0; r < 3; r++) c[r] += t[r];
            for (int j = 0; j <= k; j++) {
                for (int r = 0; r < 3; r++) arm_[r] = c[r] - at[j][r];
                cross(axis[j], arm_, partial[j]);
                for (int r = 0; r < 3; r++) speed[r] += partial[j][r] * v[j];
            }
            for (int j = 0; j <= k; j++) { /* how fast the partial velocities change */
                double one[3], other[3], relative[3];
                for (int r = 0; r < 3; r++) arm_[r] = c[r] - at[j][r], relative[r] = speed[r] - at_rate[j][r];
                cross(swung[j], arm_, one);
                cross(axis[j], relative, other);
                for (int r = 0; r < 3; r++) a[r] += (one[r] + other[r]) * v[j];
            }
            for (int r = 0; r < 3; r++)
                for (int s = 0; s < 3; s++) half[r][s] = dot(E[r], b.inertia[s]);
            for (int r = 0; r < 3; r++)
                for (int s = 0; s < 3; s++) I[r][s] = half[r][0] * E[s][0] + half[r][1] * E[s][1] + half[r][2] * E[s][2];
            double moment[3], spin[3], twist[3];
            turned(I, w, spin);
            cross(w, spin, moment);
            turned(I, alpha, spin);
            for (int r = 0; r < 3; r++) moment[r] += spin[r];
            for (int i = 0; i <= k; i++) {
                bias[i] += b.mass * dot(partial[i], a) + dot(axis[i], moment);
                turned(I, axis[i], twist);
                for (int j = 0; j <= i; j++) {
                    D[i][j] += b.mass * dot(partial[i], partial[j]) + dot(axis[j], twist);
                    D[j][i] = D[i][j];
                }
            }
        }
    }
}

#endif
