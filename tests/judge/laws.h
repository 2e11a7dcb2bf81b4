/* What acts in the joints of the plant of plant.c: the parameters, and the torques by which each effect acts.
 *
 * Sources: Canudas de Wit et al. 1995 (LuGre); Al-Bender et al. 2005 (Maxwell slip); Iwan 1966 (stops in parallel);
 * Wen 1976 (Bouc-Wen); Hunt & Crossley 1975 (contact); Eyring 1936 (thinning lubricants); Dieterich 1979 (friction
 * with the logarithm of the rate).
 */
#ifndef LAWS_H
#define LAWS_H

#include <math.h>

#define STOPS 5

/* One row of parameters a joint; the names are read from here by plant.py. */
enum parameter {
    ROTOR, LENGTH, MASS, COM_X, COM_Y, INERTIA,
    KP, KD, OBSERVER,
    DRY_POSITIVE, DRY_NEGATIVE, VISCOUS_POSITIVE, VISCOUS_NEGATIVE, CUBIC,
    CREEP, CREEP_SPEED, CREEP_FORM, /* exp(-(v/s)^2), 1/(1 + (v/s)^2), exp(-v/s) */
    POWER, POWER_EXPONENT, POWER_FORM, POWER_SPEED, /* 0 a power, 1 ln(1 + v/s) */
    THIN, THIN_SPEED, /* loss of viscous friction, v - s asinh(v/s) */
    UNEVEN, UNEVEN_SPEED, /* viscous friction that differs by direction, gently: (sqrt(v^2 + s^2) - s)/2 */
    LOAD, LOAD_SQUARE, /* of the transmitted torque, 1 and 1/(N m) */
    PATCH, PATCH_START, PATCH_END, PATCH_EDGE,
    WARM_DRY, WARM_VISCOUS, WARM_EXPONENTIAL, /* relative change when warm */
    BRISTLE, BRISTLE_DAMPING, BRISTLE_FORM, /* 0 LuGre, 1 Maxwell slip */
    COUPLED, COUPLED_CREEP, COUPLED_SPEED, /* dry friction on x = qd_i + qd_(i+1), and its part more at creep */
    GEAR_DRY, GEAR_VISCOUS, GEAR_INERTIA, GEAR_RATIO, /* of a motor that turns with qd_i + GEAR_RATIO qd_(i+1) */
    OFFSET, SPRING, SPRING_REST,
    PULL, PULL_FROM, PULL_FIRST, PULL_SOFT, /* one-sided spring below PULL_FROM, its pretension's torque, the kink's width */
    CABLE_SINE, CABLE_PHASE, CABLE_SQUARE, CABLE_CUBE,
    PACK, PACK_RADIUS, PACK_POST, PACK_FREE, PACK_AT, /* N/m; m from the joint to its two ends; slack length; angle */
    HOSE, HOSE_WIDTH, HOSE_AT, /* a sinh of the angle: a bundle that stiffens as it bends */
    STOP, STOP_AT, STOP_DAMPING, STOP_SIDE, STOP_EXPONENT,
    HYSTERESIS, HYSTERESIS_WIDTH, HYSTERESIS_FORM, /* 0 stops, 1 Bouc-Wen */
    RIPPLE, RIPPLE_ORDER, RIPPLE_PHASE, RIPPLE_SECOND, /* orders are per turn of the joint */
    LINE_B, LINE_B_ORDER, LINE_B_PHASE, LINE_C, LINE_C_ORDER, LINE_C_PHASE, /* further lines beside RIPPLE's */
    LIMIT, LIMIT_FORM, /* 0 none, 1 tanh, 2 algebraic, 3 hard, 4 command = torque + torque^3/(3 LIMIT^2) */
    GAIN, DELAY, LAG,
    STIFFNESS, STIFFNESS_DAMPING, HARDENING, GAP, GAP_EXPONENT, GAP_DEPTH, /* the flanks are as stiff as STIFFNESS at this depth */
    DRAG_AT_ANGLE, DRAG_ANGLE, /* c q^2 qd */
    BRAKE, BRAKE_SPEED, /* eddy currents, c v/(1 + (v/s)^2) */
    SWING, /* inertia a cos 2q */
    WAVE, WAVE_ORDER, WAVE_PHASE, /* dry friction that waves over the angle */
    ACROSS, /* viscous torque from the next joint's rate (the one before, at the last) */
    AXIS_X, AXIS_Y, AXIS_Z, POINT_X, POINT_Y, POINT_Z, /* in space: of the joint, in base axes where q = 0 */
    CENTRE_X, CENTRE_Y, CENTRE_Z, XX, XY, XZ, YY, YZ, ZZ, /* of the body that it turns; inertia about the centre */
    PARAMETERS
};

/* One row for the arm. A payload's centre is AHEAD of the end-effector, its radius of gyration RADIUS; in space it is at
 * X, Y, Z, in base axes where q = 0. */
enum arm_parameter {
    GRAVITY_X, GRAVITY_Y, PAYLOAD, PAYLOAD_TIME, PAYLOAD_AHEAD, PAYLOAD_RADIUS, COUNT, SUBSTEPS,
    SPATIAL, GRAVITY_Z, PAYLOAD_X, PAYLOAD_Y, PAYLOAD_Z, ARM_PARAMETERS
};

/* Slower than this a bristle is taken to hold, rad/s: no model of sliding friction speaks of it. */
#define STILL 1e-3

typedef struct {
    double z, stop[STOPS], wen, motor; /* bristle, stops, Bouc-Wen, torque of a lagging drive */
    double slip[STOPS];
} memory;

static double clamp(double x, double low, double high) { return x < low ? low : x > high ? high : x; }

/* Torque of the drive for a command: lag, limit, gain. */
static double drive(const double *p, memory *m, double command, double h)
{
    if (p[LAG] > 0.0) {
        m->motor += (1.0 - exp(-h / p[LAG])) * (command - m->motor);
        command = m->motor;
    }
    if (p[LIMIT_FORM] == 1.0) command = p[LIMIT] * tanh(command / p[LIMIT]);
    if (p[LIMIT_FORM] == 2.0) command /= sqrt(1.0 + command * command / (p[LIMIT] * p[LIMIT]));
    if (p[LIMIT_FORM] == 3.0) command = clamp(command, -p[LIMIT], p[LIMIT]);
    if (p[LIMIT_FORM] == 4.0) command = 2.0 * p[LIMIT] * sinh(asinh(1.5 * command / p[LIMIT]) / 3.0);
    return p[GAIN] * command;
}

/* Torques on the link side that oppose it: springs, cables, stops. */
static double load(const double *p, double q, double v)
{
    double torque = p[OFFSET] + p[SPRING] * (q - p[SPRING_REST]);
    if (p[PULL] != 0.0 && p[PULL_SOFT] > 0.0) {
        double x = (p[PULL_FROM] - q) / p[PULL_SOFT], taut = 1.0 / (1.0 + exp(-x));
        torque -= p[PULL] * p[PULL_SOFT] * (x > 30.0 ? x : log1p(exp(x))) + p[PULL_FIRST] * taut;
    } else if (p[PULL] != 0.0 && q < p[PULL_FROM])
        torque -= p[PULL] * (p[PULL_FROM] - q) + p[PULL_FIRST];
    if (p[CABLE_SINE] != 0.0) torque += p[CABLE_SINE] * sin(q + p[CABLE_PHASE]);
    torque += q * q * (p[CABLE_SQUARE] + p[CABLE_CUBE] * q);
    if (p[PACK] != 0.0) {
        double a = p[PACK_RADIUS], b = p[PACK_POST], length = sqrt(a * a + b * b - 2.0 * a * b * cos(q - p[PACK_AT]));
        if (length > p[PACK_FREE]) torque += p[PACK] * (1.0 - p[PACK_FREE] / length) * a * b * sin(q - p[PACK_AT]);
    }
    if (p[HOSE] != 0.0) torque += p[HOSE] * sinh((q - p[HOSE_AT]) / p[HOSE_WIDTH]);
    if (p[STOP] > 0.0) {
        double deep = p[STOP_SIDE] * (q - p[STOP_AT]);
        if (deep > 0.0) {
            double push = p[STOP_EXPONENT] == 1.0 ? p[STOP] * deep : p[STOP] * pow(deep, p[STOP_EXPONENT]);
            double damp = p[STOP_EXPONENT] == 1.0 ? p[STOP_DAMPING] : p[STOP_DAMPING] * deep;
            push += damp * p[STOP_SIDE] * v;
            torque += p[STOP_SIDE] * (push > 0.0 ? push : 0.0);
        }
    }
    return torque;
}

/* Smooth torques that oppose the motor: ripple, hysteresis, physics that no library has. */
static double smooth(const double *p, memory *m, double q, double v, double other, double h)
{
    double torque = p[ACROSS] * other;
    if (p[RIPPLE] != 0.0) {
        double angle = p[RIPPLE_ORDER] * q + p[RIPPLE_PHASE];
        torque += p[RIPPLE] * (cos(angle) + p[RIPPLE_SECOND] * cos(2.0 * angle + 1.0));
    }
    if (p[LINE_B] != 0.0) torque += p[LINE_B] * cos(p[LINE_B_ORDER] * q + p[LINE_B_PHASE]);
    if (p[LINE_C] != 0.0) torque += p[LINE_C] * cos(p[LINE_C_ORDER] * q + p[LINE_C_PHASE]);
    if (p[HYSTERESIS] > 0.0 && p[HYSTERESIS_FORM] == 0.0)
        for (int e = 0; e < STOPS; e++) {
            double width = p[HYSTERESIS_WIDTH] * (e + 1.0) / STOPS;
            m->stop[e] = clamp(m->stop[e] + h * v, -width, width);
            torque += p[HYSTERESIS] / STOPS * m->stop[e] / width;
        }
    if (p[HYSTERESIS] > 0.0 && p[HYSTERESIS_FORM] == 1.0) {
        double keep = v * m->wen > 0.0 ? 1.0 - m->wen * m->wen : 1.0;
        m->wen = clamp(m->wen + h * v / p[HYSTERESIS_WIDTH] * keep, -1.0, 1.0);
        torque += p[HYSTERESIS] * m->wen;
    }
    if (p[DRAG_AT_ANGLE] != 0.0) torque += p[DRAG_AT_ANGLE] * (q - p[DRAG_ANGLE]) * (q - p[DRAG_ANGLE]) * v;
    if (p[UNEVEN] != 0.0) torque += 0.5 * p[UNEVEN] * (sqrt(v * v + p[UNEVEN_SPEED] * p[UNEVEN_SPEED]) - p[UNEVEN_SPEED]);
    if (p[BRAKE] != 0.0) torque += p[BRAKE] * v / (1.0 + v * v / (p[BRAKE_SPEED] * p[BRAKE_SPEED]));
    return torque;
}

/* Magnitudes that friction reaches at rate v in either direction: its dry part, and what needs motion. */
typedef struct {
    double dry[2], rest[2];
} level;

static level friction(const double *p, double q, double v, double carried, double warm)
{
    level f;
    double speed = fabs(v), extra = 0.0, thin = 0.0, dry, viscous;
    if (p[CREEP] != 0.0) {
        double x = speed / p[CREEP_SPEED];
        extra += p[CREEP] * (p[CREEP_FORM] == 0.0 ? exp(-x * x) : p[CREEP_FORM] == 1.0 ? 1.0 / (1.0 + x * x) : exp(-x));
    }
    if (p[POWER] != 0.0)
        extra += p[POWER] * (p[POWER_FORM] == 0.0 ? pow(speed, p[POWER_EXPONENT]) : log1p(speed / p[POWER_SPEED]));
    if (p[THIN] != 0.0) thin = p[THIN] * (speed - p[THIN_SPEED] * asinh(speed / p[THIN_SPEED]));
    extra += fabs(carried) * (p[LOAD] + p[LOAD_SQUARE] * fabs(carried));
    if (p[PATCH] != 0.0) {
        if (p[PATCH_EDGE] == 0.0) {
            if (q > p[PATCH_START] && q < p[PATCH_END]) extra += p[PATCH];
        } else
            extra += 0.5 * p[PATCH] * (tanh((q - p[PATCH_START]) / p[PATCH_EDGE]) - tanh((q - p[PATCH_END]) / p[PATCH_EDGE]));
    }
    if (p[WAVE] != 0.0) extra += p[WAVE] * (1.0 + sin(p[WAVE_ORDER] * q + p[WAVE_PHASE]));
    dry = 1.0 + p[WARM_DRY] * warm;
    viscous = p[WARM_EXPONENTIAL] != 0.0 ? pow(1.0 + p[WARM_VISCOUS], warm) : 1.0 + p[WARM_VISCOUS] * warm;
    for (int side = 0; side < 2; side++) {
        f.dry[side] = p[side ? DRY_NEGATIVE : DRY_POSITIVE] * dry + extra;
        f.rest[side] = speed * (p[side ? VISCOUS_NEGATIVE : VISCOUS_POSITIVE] * viscous + p[CUBIC] * speed * speed) - thin;
        if (f.dry[side] < 0.0) f.dry[side] = 0.0;
        if (f.dry[side] + f.rest[side] < 0.0) f.rest[side] = -f.dry[side];
    }
    return f;
}

/* Torque of the presliding bristle that carries the dry friction of `f`. */
static double bristle(const double *p, memory *m, const level *f, double v, double h)
{
    if (p[BRISTLE_FORM] == 0.0) {
        double g = f->dry[v < 0.0] + 1e-9, before = m->z;
        m->z = (before + h * v) / (1.0 + h * p[BRISTLE] * fabs(v) / g);
        return p[BRISTLE] * m->z + p[BRISTLE_DAMPING] * (m->z - before) / h;
    }
    double torque = 0.0;
    for (int e = 0; e < STOPS; e++) { /* equal shares of the level, reached one after the other */
        double reach = (e + 0.5) / STOPS * 2.0 / p[BRISTLE];
        m->slip[e] = clamp(m->slip[e] + h * v, -reach * f->dry[1], reach * f->dry[0]);
        torque += m->slip[e] / reach / STOPS;
    }
    return torque + p[BRISTLE_DAMPING] * v * exp(-fabs(v) / 0.02);
}

/* Torque that the transmission of a flexible joint carries. */
static double transmission(const double *p, double twist, double rate)
{
    double half = 0.5 * p[GAP];
    if (p[GAP] > 0.0) {
        if (fabs(twist) <= half) return 0.0;
        double deep = twist > 0.0 ? twist - half : twist + half;
        double grown = p[GAP_EXPONENT] == 1.0 ? 1.0 : pow(fabs(deep) / p[GAP_DEPTH], p[GAP_EXPONENT] - 1.0);
        double torque = grown * (p[STIFFNESS] * deep + p[STIFFNESS_DAMPING] * rate);
        return torque * deep > 0.0 ? torque : 0.0;
    }
    return p[STIFFNESS] * twist * (1.0 + p[HARDENING] * twist * twist) + p[STIFFNESS_DAMPING] * rate;
}

#endif
