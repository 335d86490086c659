/* Checks of settings, and what a flight with declared errors keeps (shields.settings) */
#ifndef QS_SETTINGS_H
#define QS_SETTINGS_H

#include "qs_tube.h"

/* Poles of the feedbacks onto a stop, to rest, out of a body, and of the easing, 1/s. */
#define TRACKING_POLE 30
#define BRAKING_POLE 3
#define RECOVERY_POLE 6
#define EASING_POLE 20
#define SPARED Q(0.75) /* of the margin, what may not be used up at the border */

static int is_positive(qs_real x) { return 0 < x && x < INF; }
static int is_bound(qs_real x) { return 0 <= x && x < TOO_FAR; }

static int is_uncertain(const qs_uncertainty *told) {
    return told->position > 0 || told->velocity > 0 || told->acceleration > 0 || told->jerk > 0 ||
           told->snap > 0 || told->gain > 0 || told->wind > 0 || told->delay > 0 || told->losses ||
           told->rotor_lag > 0 || told->impulse > 0 || told->jitter > 0;
}

static int checked_settings(const qs_settings *s) {
    const qs_uncertainty *u = &s->uncertainty;
    if (!(is_positive(s->snap_max) && s->reserve >= 1 && s->reserve < INF && is_positive(s->alpha) &&
          0 <= s->margin && s->margin < INF && 0 <= s->specific_thrust_min && s->jerk_max > 0 &&
          is_positive(s->gravity) && s->specific_thrust_min < s->gravity &&
          s->gravity < s->specific_thrust_max && s->held_snap_max >= s->snap_max * s->reserve &&
          s->snap_max * s->reserve < TOO_FAR))
        return QS_BAD_SETTINGS;
    int is_told = is_bound(u->position) && is_bound(u->velocity) && is_bound(u->acceleration) &&
                  is_bound(u->jerk) && is_bound(u->snap) && is_bound(u->gain) && u->gain < 1 &&
                  is_bound(u->wind) && is_bound(u->rotor_lag) && is_bound(u->impulse) &&
                  is_bound(u->impulse_gap) && (u->impulse > 0) == (u->impulse_gap > 0) &&
                  is_bound(u->jitter) && u->jitter < 1 && is_bound(u->rotor_lag_most) &&
                  (u->rotor_lag_most == 0 || (0 < told_lag(u) && u->rotor_lag <= u->rotor_lag_most));
    return is_told && u->delay >= 0 && u->delay <= QS_MAX_DELAY ? QS_DONE : QS_BAD_UNCERTAINTY;
}

/* What half-spaces and stops count on, so that a vehicle in the tube around them keeps to the settings. */
static int take_tube(const qs_settings *s, qs_real period, qs_rules *rules) {
    const qs_uncertainty *told = &s->uncertainty;
    qs_limits *limits = &rules->limits;
    tube_of_errors tube = {{0}, 0, {0}};
    wrongs wrong;
    rules->has_tube = is_uncertain(told);
    if (!rules->has_tube) return QS_DONE;
    /* Where an error is a share of any snap whatever, no snap is too long. */
    int has_shares = told->gain > 0 || told->jitter > 0 || told->rotor_lag_most > told->rotor_lag;
    if (has_shares && limits->snap_max == INF) limits->snap_max = rules->input_max;
    wrong_in(told, period, limits->snap_max, &wrong);
    if (wrong.shortest < Q(1e-4)) return QS_BAD_PERIOD;
    if (wrong.apart < 1 || !best_tube(&wrong, limits, &tube)) return QS_BAD_UNCERTAINTY;
    limits->stop_snap_max -= tube.feedback, limits->jerk_max -= tube.deviation[3];
    limits->thrust_min += tube.deviation[2], limits->thrust_max -= tube.deviation[2];
    memcpy(rules->tracking, tube.gains, sizeof tube.gains);
    rules->tube = tube.deviation[0], rules->estimate = tube.deviation[0] + wrong.error[0];
    return QS_DONE;
}

#endif
