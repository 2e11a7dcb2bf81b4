/* A serial arm with harmonic drives under position control, to judge a diagnosis by; planar, or in space by space.h.
 *
 * Set-valued dry friction by Moreau's time stepping: positions at the middle of a substep, smooth forces
 * there, the impulses of friction from the velocities at its end by projected Gauss-Seidel. Second order
 * in the smooth forces, and a joint at rest is exactly at rest. The equations of motion in the plane are those of the
 * absolute angles of the links. Units are SI; angles of motors are behind the gear, at the joint.
 *
 * Sources: Moreau 1988 (time stepping); Spong 1987 (flexible joints); laws.h has what acts in the joints.
 */
#include <math.h>
#include <string.h>

#define MOST 7

#include "laws.h"
#include "space.h"

#define HISTORY 64 /* commands kept, for delays up to this many periods */

int plant_parameters(void) { return PARAMETERS; }
int plant_arm_parameters(void) { return ARM_PARAMETERS; }

typedef struct {
    int n;
    const double (*p)[PARAMETERS];
    const double *arm;
    double first[MOST][2]; /* first moment of link k and all behind it, in link k's frame */
    double own[MOST];      /* inertia of link k and all behind it about joint k, if they moved as points */
    double payload;
} body;

static void masses(body *b, double payload)
{
    b->payload = payload;
    double behind = payload, ahead = b->arm[PAYLOAD_AHEAD], radius = b->arm[PAYLOAD_RADIUS];
    for (int k = b->n - 1; k >= 0; k--) {
        const double *p = b->p[k];
        b->first[k][0] = p[MASS] * p[COM_X] + behind * p[LENGTH];
        b->first[k][1] = p[MASS] * p[COM_Y];
        b->own[k] = p[INERTIA] + p[MASS] * (p[COM_X] * p[COM_X] + p[COM_Y] * p[COM_Y]) + behind * p[LENGTH] * p[LENGTH];
        behind += p[MASS];
    }
    b->first[b->n - 1][0] += payload * ahead;
    b->own[b->n - 1] += payload * (radius * radius + ahead * (2.0 * b->p[b->n - 1][LENGTH] + ahead));
}

/* Inertia D (n, n) of the links at joint angles q, and the torque of Coriolis, centrifugal and gravity forces. */
static void links(const body *b, const double *q, const double *v, double D[MOST][MOST], double *bias)
{
    double s[MOST], c[MOST], rate[MOST], H[MOST][MOST], Q[MOST], angle = 0.0, turn = 0.0;
    int n = b->n;
    for (int k = 0; k < n; k++) {
        angle += q[k];
        turn += v[k];
        rate[k] = turn;
        s[k] = sin(angle);
        c[k] = cos(angle);
        Q[k] = 0.0;
    }
    for (int k = 0; k < n; k++) {
        double x = c[k] * b->first[k][0] - s[k] * b->first[k][1], y = s[k] * b->first[k][0] + c[k] * b->first[k][1];
        Q[k] += y * b->arm[GRAVITY_X] - x * b->arm[GRAVITY_Y];
        H[k][k] = b->own[k];
        for (int j = 0; j < k; j++) {
            double l = b->p[j][LENGTH];
            double across = l * (c[j] * y - s[j] * x);
            H[j][k] = H[k][j] = l * (c[j] * x + s[j] * y);
            Q[j] -= across * rate[k] * rate[k];
            Q[k] += across * rate[j] * rate[j];
        }
    }
    for (int j = n - 2; j >= 0; j--) { /* to relative angles: sums over all links behind */
        Q[j] += Q[j + 1];
        for (int k = 0; k < n; k++) H[j][k] += H[j + 1][k];
    }
    for (int k = n - 2; k >= 0; k--)
        for (int j = 0; j < n; j++) H[j][k] += H[j][k + 1];
    for (int j = 0; j < n; j++) {
        bias[j] = Q[j];
        for (int k = 0; k < n; k++) D[j][k] = H[j][k];
    }
}

/* W = D^-1 of a positive definite matrix, by Gauss-Jordan without pivoting. */
static void invert(int n, double D[MOST][MOST], double W[MOST][MOST])
{
    if (n == 1) {
        W[0][0] = 1.0 / D[0][0];
        return;
    }
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) W[i][j] = D[i][j];
    for (int k = 0; k < n; k++) {
        double pivot = 1.0 / W[k][k];
        W[k][k] = 1.0;
        for (int j = 0; j < n; j++) W[k][j] *= pivot;
        for (int i = 0; i < n; i++) {
            if (i == k) continue;
            double factor = W[i][k];
            W[i][k] = 0.0;
            for (int j = 0; j < n; j++) W[i][j] -= factor * W[k][j];
        }
    }
}

typedef struct {
    double q[MOST], v[MOST], m[MOST], w[MOST]; /* link and motor, angle and rate */
    double dv[MOST], dw[MOST];                 /* accelerations of the last substep */
    double carried[MOST], impulse[MOST];
    double bent[MOST]; /* torque of a bristle as a part of its level */
    memory memory[MOST];
} state;

/* Motors between two joints: their inertia into D (n, n), their friction into the forces f. For rigid joints. */
static void couple(const body *b, const double *w, double D[MOST][MOST], double *f)
{
    for (int i = 0; i + 1 < b->n; i++) {
        const double *p = b->p[i];
        double r = p[GEAR_RATIO], rate = w[i] + r * w[i + 1];
        double rub = p[GEAR_DRY] * tanh(rate / 0.002) + p[GEAR_VISCOUS] * rate;
        D[i][i] += p[GEAR_INERTIA];
        D[i][i + 1] += p[GEAR_INERTIA] * r;
        D[i + 1][i] += p[GEAR_INERTIA] * r;
        D[i + 1][i + 1] += p[GEAR_INERTIA] * r * r;
        f[i] -= rub;
        f[i + 1] -= r * rub;
    }
}

/* One substep. share (n, 2): the friction of this substep as a part of its level in each direction, 1 in motion. */
static void step(const body *b, state *x, const double *torque, const double *outside, const double *warm, double h,
                 double share[MOST][2])
{
    int n = b->n;
    double D[MOST][MOST], W[MOST][MOST], q[MOST], m[MOST], v[MOST], w[MOST], bias[MOST], f[MOST], g[MOST];
    double free[MOST], low[MOST], high[MOST], weight[MOST];
    for (int i = 0; i < n; i++) {
        q[i] = x->q[i] + 0.5 * h * x->v[i];
        m[i] = x->m[i] + 0.5 * h * x->w[i];
        v[i] = x->v[i] + 0.5 * h * x->dv[i];
        w[i] = x->w[i] + 0.5 * h * x->dw[i];
    }
    if (b->arm[SPATIAL] != 0.0)
        kane(n, b->p, b->arm, b->payload, q, v, D, bias);
    else
        links(b, q, v, D, bias);
    for (int i = 0; i < n; i++) {
        const double *p = b->p[i];
        int flexible = p[STIFFNESS] > 0.0, next = i + 1 < n ? i + 1 : i - 1;
        level r = friction(p, m[i], w[i], x->carried[i], warm[i]);
        double opposing = smooth(p, &x->memory[i], m[i], w[i], n > 1 ? w[next] : 0.0, h);
        if (p[SWING] != 0.0) {
            D[i][i] += p[SWING] * cos(2.0 * q[i]);
            bias[i] -= p[SWING] * sin(2.0 * q[i]) * v[i] * v[i];
        }
        if (p[BRISTLE] > 0.0) {
            double held = bristle(p, &x->memory[i], &r, w[i], h);
            opposing += held;
            x->bent[i] = fabs(w[i]) > STILL ? (w[i] > 0.0 ? 1.0 : -1.0) : clamp(held / (r.dry[held < 0.0] + 1e-9), -1.0, 1.0);
            r.dry[0] = r.dry[1] = 0.0;
        }
        high[i] = h * (r.dry[0] + r.rest[0]);
        low[i] = -h * (r.dry[1] + r.rest[1]);
        double twisted = flexible ? transmission(p, m[i] - q[i], w[i] - v[i]) : 0.0;
        g[i] = torque[i] - opposing;                         /* on the motor */
        f[i] = outside[i] - bias[i] - load(p, q[i], v[i]); /* on the link */
        if (flexible) {
            f[i] += twisted;
            g[i] -= twisted;
            x->carried[i] = twisted;
        } else {
            D[i][i] += p[ROTOR];
            f[i] += g[i];
        }
    }
    for (int i = 0; i + 1 < n; i++)
        if (b->p[i][COUPLED] != 0.0) {
            double x = w[i] + w[i + 1], creep = b->p[i][COUPLED_CREEP] * exp(-fabs(x) / b->p[i][COUPLED_SPEED]);
            double rub = b->p[i][COUPLED] * tanh(x / 0.002) * (1.0 + creep);
            f[i] -= rub;
            f[i + 1] -= rub;
        }
    couple(b, w, D, f);
    invert(n, D, W);
    for (int i = 0; i < n; i++) {
        free[i] = x->v[i];
        for (int j = 0; j < n; j++) free[i] += h * W[i][j] * f[j];
        weight[i] = W[i][i];
    }
    for (int i = 0; i < n; i++) { /* motors in front of a spring are alone; the others start from the last impulse */
        const double *p = b->p[i];
        if (p[STIFFNESS] > 0.0) {
            double end = x->w[i] + h * g[i] / p[ROTOR];
            double P = clamp(end * p[ROTOR], low[i], high[i]);
            x->impulse[i] = P;
            end = P > low[i] && P < high[i] ? 0.0 : end - P / p[ROTOR];
            x->dw[i] = (end - x->w[i]) / h;
            x->m[i] += 0.5 * h * (x->w[i] + end);
            x->w[i] = end;
        } else {
            double P = clamp(x->impulse[i], low[i], high[i]);
            x->impulse[i] = P;
            for (int j = 0; j < n; j++) free[j] -= W[j][i] * P;
        }
    }
    for (int round = 0; round < 50; round++) {
        double change = 0.0;
        for (int i = 0; i < n; i++) {
            if (b->p[i][STIFFNESS] > 0.0) continue;
            double P = clamp(x->impulse[i] + free[i] / weight[i], low[i], high[i]);
            double by = P - x->impulse[i];
            if (by == 0.0) continue;
            x->impulse[i] = P;
            for (int j = 0; j < n; j++) free[j] -= W[j][i] * by;
            change += fabs(by) * weight[i];
        }
        if (change < 1e-12 || n == 1) break;
    }
    for (int i = 0; i < n; i++) {
        const double *p = b->p[i];
        if (!(p[STIFFNESS] > 0.0) && x->impulse[i] < high[i] && x->impulse[i] > low[i]) free[i] = 0.0; /* held */
        x->dv[i] = (free[i] - x->v[i]) / h;
        x->q[i] += 0.5 * h * (x->v[i] + free[i]);
        x->v[i] = free[i];
        if (!(p[STIFFNESS] > 0.0)) {
            x->carried[i] = g[i] - x->impulse[i] / h - p[ROTOR] * x->dv[i];
            x->m[i] = x->q[i];
            x->w[i] = x->v[i];
            x->dw[i] = x->dv[i];
        }
        int side = x->impulse[i] < 0.0;
        double bound = side ? -low[i] : high[i];
        share[i][0] = share[i][1] = 0.0;
        if (p[BRISTLE] > 0.0)
            share[i][x->bent[i] < 0.0] = fabs(x->bent[i]);
        else if (bound > 0.0)
            share[i][side] = fabs(x->impulse[i]) / bound;
    }
}

typedef struct {
    double angle[MOST], rate[MOST]; /* the controller's observer */
    double command[HISTORY][MOST];
} controller;

/* The mean over [start, end] of the commands as they arrive `late`; all in periods from the present command's. */
static double delayed(const controller *c, int now, int joint, double start, double end, double late)
{
    double from = start - late, to = end - late, edge = floor(to);
    int first = now + (int)floor(from), second = now + (int)edge;
    double part = first == second ? 0.0 : (to - edge) / (to - from);
    int oldest = now - HISTORY + 1 > 0 ? now - HISTORY + 1 : 0;
    first = first < oldest ? oldest : first;
    second = second < oldest ? oldest : second;
    return (1.0 - part) * c->command[first % HISTORY][joint] + part * c->command[second % HISTORY][joint];
}

/* Simulates `count` periods of a joint controller with held commands.
 *
 * arm (ARM_PARAMETERS), joints (n, PARAMETERS)
 * period (count) s; desired, speed, acceleration, forward (n, count): what the controller follows
 * outside (n, count) N m: torques that push the links; warm (n, count): 0 cold to 1 warm
 * Returns in q, tau, mean_rate, mean_acceleration, above, below, link (n, count): the motor's angle at the
 * samples, the command of the period that begins there, the means over that period of the motor's rate and
 * acceleration and of friction as a part of its level in either direction (of a bristle: above STILL 1),
 * and the link's angle.
 * Returns 0, or the number of the first period in which a joint ran away.
 */
int plant_simulate(int n, int count, const double *arm, const double *joints, const double *period, const double *desired,
                   const double *speed, const double *acceleration, const double *forward, const double *outside,
                   const double *warm, double *q, double *tau, double *mean_rate, double *mean_acceleration,
                   double *above, double *below, double *link)
{
    body b;
    state x;
    controller c;
    int substeps = (int)arm[SUBSTEPS];
    double time = 0.0;
    int loaded = 0;
    memset(&b, 0, sizeof b);
    memset(&x, 0, sizeof x);
    memset(&c, 0, sizeof c);
    b.n = n;
    b.p = (const double(*)[PARAMETERS])joints;
    b.arm = arm;
    masses(&b, 0.0);
    for (int i = 0; i < n; i++) x.q[i] = x.m[i] = c.angle[i] = desired[(long)i * count];
    for (int k = 0; k < count; k++) {
        double dt = period[k], push[MOST], heat[MOST], before[MOST], rate[MOST];
        if (!loaded && arm[PAYLOAD] != 0.0 && time >= arm[PAYLOAD_TIME]) {
            masses(&b, arm[PAYLOAD]);
            loaded = 1;
        }
        for (int i = 0; i < n; i++) {
            long s = (long)i * count + k;
            const double *p = b.p[i];
            double seen = floor(x.m[i] / arm[COUNT] + 0.5) * arm[COUNT], miss = seen - c.angle[i];
            double gain = p[OBSERVER] * dt;
            c.angle[i] += 2.0 * gain * miss;
            c.rate[i] += p[OBSERVER] * gain * miss;
            double command = forward[s] + p[KP] * (desired[s] - seen) + p[KD] * (speed[s] - c.rate[i]);
            c.command[k % HISTORY][i] = command;
            c.angle[i] += dt * c.rate[i] + 0.5 * dt * dt * acceleration[s];
            c.rate[i] += dt * acceleration[s];
            q[s] = x.m[i];
            link[s] = x.q[i];
            tau[s] = command;
            above[s] = below[s] = 0.0;
            push[i] = outside[s];
            heat[i] = warm[s];
            before[i] = x.m[i];
            rate[i] = x.w[i];
            if (!(fabs(x.m[i]) < 100.0)) return k + 1;
        }
        for (int j = 0; j < substeps; j++) {
            double h = dt / substeps, torque[MOST], share[MOST][2];
            for (int i = 0; i < n; i++) {
                double command = tau[(long)i * count + k], late = b.p[i][DELAY] / dt;
                if (late > 0.0) command = delayed(&c, k, i, j / (double)substeps, (j + 1) / (double)substeps, late);
                torque[i] = drive(b.p[i], &x.memory[i], command, h);
            }
            step(&b, &x, torque, push, heat, h, share);
            for (int i = 0; i < n; i++) {
                above[(long)i * count + k] += share[i][0] / substeps;
                below[(long)i * count + k] += share[i][1] / substeps;
            }
        }
        for (int i = 0; i < n; i++) {
            mean_rate[(long)i * count + k] = (x.m[i] - before[i]) / dt;
            mean_acceleration[(long)i * count + k] = (x.w[i] - rate[i]) / dt;
        }
        time += dt;
    }
    return 0;
}
