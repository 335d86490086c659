/* quadsafe: a shield for a quadrotor, in C99.
 *
 * It turns a desired snap into one after which a stop that clears every obstacle is known. It is the method
 * "sampled" of the Python package for one vehicle: in double, compiled with -ffp-contract=off, it gives the
 * same bits. No allocation, no static state, no recursion, every loop bounded; the caller owns all memory.
 * SI units, world frame, z up. docs/onboard.md says what differs from Python, and why.
 */
#ifndef QUADSAFE_H
#define QUADSAFE_H

#ifdef QS_FLOAT
typedef float qs_real;
#else
typedef double qs_real; /* float with -DQS_FLOAT */
#endif

/* Places for obstacles, and for answers that are on their way. */
#ifndef QS_MAX_OBSTACLES
#define QS_MAX_OBSTACLES 16
#endif
#ifndef QS_MAX_DELAY
#define QS_MAX_DELAY 4
#endif

/* What a function says of what it was given. With any code but QS_DONE the answer is the stored stop. */
enum {
    QS_DONE = 0,
    QS_BAD_POINTER,     /* NULL where there must be something */
    QS_BAD_SETTINGS,    /* a setting out of its range, or a shield whose qs_init failed */
    QS_BAD_UNCERTAINTY, /* errors out of their range, or too large for a stop at this period */
    QS_BAD_PERIOD,      /* not from 1e-9 to 1 s; with declared errors the shortest one below 1e-4 s */
    QS_BAD_COUNT,       /* more obstacles than places, fewer than none, or others than at the first call */
    QS_BAD_STATE,       /* position, velocity, acceleration or jerk not finite or far too large */
    QS_BAD_OBSTACLE,    /* not made by the functions below, or of what they do not take */
    QS_BAD_TIME,        /* with jitter: qs_held_for was not called since the last answer, or told no time */
    QS_TOO_LARGE        /* usable numbers whose answer is none */
};

/* Bounds of what the shield does not know, all 0 by default; see Uncertainty in Python. */
typedef struct {
    qs_real position, velocity, acceleration, jerk; /* of the estimate, m, m/s, m/s2, m/s3 */
    qs_real snap, gain;                             /* flown on top of the snap, m/s4; as a share of it */
    qs_real wind;                                   /* m/s2 */
    int delay;                                      /* periods until an answer is flown */
    int losses;                                     /* whether answers may be lost */
    qs_real rotor_lag, rotor_lag_most;              /* s; of an interval least and most, else the latter 0 */
    qs_real impulse, impulse_gap;                   /* a push, m/s; least time between two, s */
    qs_real jitter;                                 /* of the period; qs_held_for is told */
} qs_uncertainty;

/* INFINITY stands for no limit. */
typedef struct {
    qs_real snap_max, reserve, held_snap_max, jerk_max; /* m/s4, -, m/s4, m/s3 */
    qs_real alpha, margin;                              /* 1/s, of a radius */
    qs_real specific_thrust_min, specific_thrust_max;   /* m/s2 */
    qs_real gravity;                                    /* m/s2 */
    qs_uncertainty uncertainty;
} qs_settings;

typedef struct {
    qs_real x, y, z;
} qs_vec;

enum { QS_INVALID, QS_SPHERE, QS_CAPSULE, QS_CYLINDER, QS_BOX, QS_HULL, QS_HALF_SPACE };

/* A core that moves at constant velocity, grown by a ball. A sphere of radius 0 is none. */
typedef struct {
    int kind;
    qs_vec center, velocity;
    qs_real radius;
    qs_vec axes[3];             /* unit vectors */
    qs_real half[3];            /* half lengths along them; of a hull the size */
    const qs_real (*points)[3]; /* of a hull */
    int count;
} qs_obstacle;

typedef struct {
    qs_real snap[3];
    int certified;      /* whether a stop that clears every obstacle is stored */
    int intervened;     /* whether the snap differs from the desired one */
    qs_real correction; /* by how much, m/s4 */
    qs_real value;      /* least set value, m; INFINITY without an obstacle */
    qs_real reserve;    /* largest input an obstacle asked for, in units of snap_max */
    int obstacle;       /* the one that asked for the largest correction, -1 for none */
    int in_set, fallback, refused, stopped;
} qs_answer;

/* A flat state, or with a lag its lead and the vehicle behind that. */
typedef struct {
    qs_vec r, v, a, j;
    qs_vec own_r, own_a, own_j;
    qs_real lag; /* s; 0 for none */
} qs_state;

/* A stored stop. */
typedef struct {
    qs_state begin;     /* where the segment that is flown began */
    qs_vec frame;       /* the velocity with which the stop ends */
    float periods_left; /* of that segment */
    int segments_left;
    int choice; /* which of the thirteen lengths a segment has */
    int is_stored;
} qs_stop;

/* A half-space of snaps, n.u >= least. */
typedef struct {
    qs_vec n;
    qs_real least;
} qs_half_space_of;

/* What a certified flight keeps. */
typedef struct {
    qs_real snap_max, stop_snap_max, jerk_max, thrust_min, thrust_max, gravity;
} qs_limits;

/* What a control period fixes. */
typedef struct {
    qs_real period, u_max, gamma, input_max, margin;
    qs_limits limits;
    qs_real tracking[4], braking[3], recovery[3];
    qs_real easing[4], easing_left, easing_within;
    int has_tube;
    qs_real tube, estimate; /* m */
} qs_rules;

/* The memory of one vehicle. Its fields are the shield's own. */
typedef struct {
    int is_ready, count, chain, is_lost;
    qs_settings settings;
    qs_rules rules;
    qs_stop stop, before;
    qs_state front, last;
    qs_vec lagged, flown, pending[QS_MAX_DELAY];
    qs_real lag, followed, late; /* s; periods that the last answer was held beyond one, not a number if untold */
    qs_half_space_of chosen[QS_MAX_OBSTACLES], entered[QS_MAX_OBSTACLES];
    qs_vec center[QS_MAX_OBSTACLES], center_now[QS_MAX_OBSTACLES];
    qs_real keep[QS_MAX_OBSTACLES], ahead[QS_MAX_OBSTACLES], stored[QS_MAX_OBSTACLES], bare[QS_MAX_OBSTACLES];
} qs_shield;

void qs_defaults(qs_settings *settings);
/* An empty memory: 0 or a QS_BAD_ code. */
int qs_init(qs_shield *shield, const qs_settings *settings);
/* What qs_filter does by itself at a new period, beforehand: with declared errors that takes long. */
int qs_prepare(qs_shield *shield, qs_real period);

/* Obstacles at their keep-out radii, m. A velocity may be NULL: at rest. */
qs_obstacle qs_sphere(const qs_real center[3], qs_real radius, const qs_real velocity[3]);
qs_obstacle qs_capsule(const qs_real start[3], const qs_real end[3], qs_real radius, const qs_real velocity[3]);
qs_obstacle qs_cylinder(const qs_real start[3], const qs_real end[3], qs_real radius,
                        const qs_real velocity[3]);
/* rotation: from its axes to the world's, row-major; NULL: none. */
qs_obstacle qs_box(const qs_real center[3], const qs_real size[3], const qs_real rotation[9],
                   const qs_real velocity[3]);
/* Keeps the pointer. */
qs_obstacle qs_hull(const qs_real (*points)[3], int count, qs_real radius, const qs_real velocity[3]);
/* Solid where normal.r < offset. */
qs_obstacle qs_half_space(const qs_real normal[3], qs_real offset);

/* The safe snap of one control period; flat: position, velocity, acceleration, jerk. */
int qs_filter(qs_shield *shield, const qs_real flat[4][3], const qs_obstacle *obstacles, int count,
              const qs_real snap[3], qs_real period, qs_answer *answer);
/* What is flown in place of the last answer, if that was lost: the stop that was stored before it. Called again,
 * with no qs_filter between, it goes on along that stop by a period, without a measurement. */
void qs_backup(qs_shield *shield, qs_real snap[3]);
/* For how long the last answer was held, up to 1 s: with jitter before every further qs_filter. */
int qs_held_for(qs_shield *shield, qs_real seconds);

/* The rigid body (29): r, v, attitude from body to world row by row, angular velocity, thrust, its rate. */
typedef struct {
    qs_real mass, inertia[3], gravity;
} qs_body;
int qs_flat_state(const qs_real state[20], const qs_body *body, qs_real flat[4][3]);
/* (35): F_z and the torques that give a snap and an angular acceleration about the body's z axis. */
int qs_wrench_from_snap(const qs_real state[20], const qs_real snap[3], qs_real yaw_acceleration,
                        const qs_body *body, qs_real wrench[4]);

#endif
