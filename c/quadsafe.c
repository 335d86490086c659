/* The shield of quadsafe.h: one file to compile. From the mathematics up, each part with the name of the Python
 * module that has its proof; equations are those of the paper and of docs/theory:
 *
 *     qs_numbers.h    numbers, vectors, roots            qs_arcs.h         arcs under a held snap
 *     qs_chain.h      the invariant set, the filter      qs_hull.h         a whole stop in one hull
 *     qs_project.h    least correction                   qs_certificate.h  what may be flown
 *     qs_shapes.h     distances and supports             qs_recovery.h     the way out of a body
 *     qs_stop.h       the stored stop                    qs_halfspace.h    half-spaces of snaps
 *     qs_settings.h   settings                           qs_tube.h         gains, the tube of errors
 */
#include "qs_certificate.h"
#include "qs_halfspace.h"
#include "qs_recovery.h"
#include "qs_settings.h"

/* ---- one vehicle among bodies for one period (shields.methods.sampled_row) ---- */

/* What rounding may do to a distance seen from r, a gap from the centre. */
static qs_real rounding_at(qs_vec r, qs_vec gap) {
    return EITHER(1e-9, 1e-6) + EITHER(1e-14, 1e-6) * (reach_of(r) + reach_of(gap));
}

/* What a vehicle at r keeps surely of where it is, a gap from the centre. */
static qs_real distance_here(const qs_obstacle *core, qs_vec r, qs_vec gap) {
    return core ? distance_from(core, gap) - rounding_at(r, gap) : JUST_INSIDE * norm(gap);
}

/* The distances that a new stop keeps, and the stored one, off which the vehicle is, and bare. A new stop begins
 * where the vehicle is, and keeps what distance there is. In a tube both keep the whole distance. */
static void distances_to_keep(qs_shield *shield, const bodies *all) {
    const qs_rules *rules = &shield->rules;
    qs_vec r = shield->last.r;
    qs_real off = norm(subtract(reference(&shield->stop, rules->period).r, r));
    for (int k = 0; k < all->count; ++k) {
        const qs_obstacle *core = core_of(all, k);
        qs_vec gap = subtract(r, all->center[k]);
        qs_real radius = all->keep[k], rounding = rounding_at(r, gap);
        shield->ahead[k] = shield->stored[k] = shield->bare[k] = 0;
        if (!is_there(core, radius)) continue;
        shield->ahead[k] = widened(core, radius, rules->margin / 2), shield->bare[k] = radius;
        shield->stored[k] = core ? radius - rounding : (1 - EITHER(1e-9, 1e-6)) * radius;
        if (rules->has_tube) {
            shield->stored[k] += 2 * most_of(off - rules->estimate, 0);
            shield->bare[k] -= rules->tube;
        } else {
            shield->ahead[k] = least_of(shield->ahead[k], distance_here(core, r, gap));
            shield->stored[k] += 2 * off;
        }
    }
}

/* The limits of a flight; what a vehicle begins outside of may get no worse. In a tube they stand. */
static qs_limits limits_at(const qs_state *x, const qs_rules *rules) {
    qs_limits limits = rules->limits;
    if (rules->has_tube) return limits;
    qs_real thrust = norm(combined(x->a, limits.gravity, UP));
    limits.jerk_max = most_of(limits.jerk_max, norm(x->j) / JUST_INSIDE);
    limits.thrust_min = least_of(limits.thrust_min, JUST_INSIDE * thrust);
    limits.thrust_max = most_of(limits.thrust_max, thrust / JUST_INSIDE);
    return limits;
}

/* Without a stop: leave the bodies, or else brake and push off them, off the most demanding in a conflict. */
static qs_vec backup_snap(qs_shield *shield, const bodies *all, qs_answer *fact) {
    const qs_rules *rules = &shield->rules;
    const qs_state *x = &shield->last;
    qs_vec u, brake = braking(x->v, x->a, x->j, rules->braking);
    if (recovery_snap(shield, all, fact, &u)) return u;
    int is_feasible = nearest_snap(shield, brake, 0, all, fact, &u);
    if (!(is_feasible && norm(u) <= norm(brake) + 2 * rules->input_max))
        u = fact->obstacle >= 0 ? scale(rules->input_max, shield->chosen[fact->obstacle].n) : brake;
    return within_ball(u, rules->limits.snap_max);
}

/* Whether the vehicle is in the shell that a tube keeps around a body, in no body, and on no stop that counts
 * (shields.backup.certificate). */
static int is_lost(const qs_shield *shield, const bodies *all) {
    int is_near = 0;
    for (int k = 0; k < all->count; ++k) {
        const qs_obstacle *core = core_of(all, k);
        if (!is_there(core, shield->ahead[k])) continue;
        qs_real here = distance_here(core, shield->last.r, subtract(shield->last.r, all->center[k]));
        if (here < shield->bare[k]) return 0;
        is_near |= here < shield->ahead[k];
    }
    return is_near && standing(shield, all) != STOPPED;
}

/* There nothing is certified, but of the distance that there is as much is kept as a stop can keep: the snap out
 * of the shell, or a stop. */
static qs_vec kept_snap(qs_shield *shield, const bodies *all, const qs_limits *limits, qs_answer *fact, int *kind) {
    static const qs_real SHARES[] = {1, Q(0.5), 0};
    qs_vec r = shield->last.r, leaving = backup_snap(shield, all, fact);
    qs_real near[QS_MAX_OBSTACLES];
    for (int k = 0; k < all->count; ++k) {
        const qs_obstacle *core = core_of(all, k);
        qs_real here = distance_here(core, r, subtract(r, all->center[k]));
        near[k] = is_there(core, shield->ahead[k]) ? least_of(shield->ahead[k], here) : 0;
    }
    for (int i = 0; i < 3; ++i) {
        for (int k = 0; k < all->count; ++k)
            shield->ahead[k] = shield->stored[k] =
                shield->bare[k] + SHARES[i] * (near[k] - shield->bare[k]);
        qs_vec u = certified_snap(shield, leaving, 1, all, limits, kind);
        if (*kind != UNCERTIFIED) {
            *kind = *kind >= STOPPED ? ASTRAY : UNCERTIFIED;
            return u;
        }
    }
    return leaving;
}

/* Project, certify, at once or piece by piece, and else fly the stored stop; what it is. */
static qs_vec careful_snap(qs_shield *shield, qs_vec wanted, int is_wanted, int is_chosen, const bodies *all,
                           qs_answer *fact, int *kind) {
    qs_vec u;
    *kind = UNCERTIFIED;
    if (!shield->rules.has_tube && is_within(shield->last.r, all)) {
        shield->stop.is_stored = 0;
        recovery_snap(shield, all, fact, &u);
        return u;
    }
    is_wanted &= nearest_snap(shield, wanted, is_chosen, all, fact, &u);
    *kind = ACCEPTED;
    if (is_wanted && is_chosen && accept_at_once(shield, u, all)) return u;
    distances_to_keep(shield, all);
    qs_limits limits = limits_at(&shield->last, &shield->rules);
    if (shield->rules.has_tube && is_lost(shield, all)) return kept_snap(shield, all, &limits, fact, kind);
    u = certified_snap(shield, u, is_wanted, all, &limits, kind);
    return *kind == UNCERTIFIED ? backup_snap(shield, all, fact) : u;
}

static void open_answer(qs_answer *fact) {
    memset(fact, 0, sizeof *fact);
    fact->value = INF, fact->obstacle = -1;
}

/* Nothing could be decided. */
static void refuse(qs_answer *fact) {
    open_answer(fact);
    fact->value = 0, fact->fallback = fact->refused = fact->intervened = 1;
}

/* Write down the snap, correction, membership, intervention; 0 if the snap is not a number. */
static int write_answer(qs_answer *fact, qs_vec wanted, qs_vec u) {
    write3(fact->snap, u);
    fact->correction = norm(subtract(u, wanted));
    fact->in_set = fact->value >= -EITHER(1e-9, 1e-6);
    fact->intervened = !is_same(u, wanted);
    return is_finite(u) && !isnan(fact->value);
}

/* The answer for the state that was last seen; 0 if it is not a number. */
static int filter_row(qs_shield *shield, qs_vec wanted, const bodies *all, qs_answer *fact) {
    const qs_state *x = &shield->last;
    int kind, is_outside;
    open_answer(fact);
    fact->fallback = !is_finite(wanted);
    if (fact->fallback) wanted = braking(x->v, x->a, x->j, shield->rules.braking);
    int is_wanted = !fact->fallback, cuts = choose_directions(shield, wanted, all, fact, &is_outside);
    if (is_wanted && is_outside && !cuts && accept_at_once(shield, wanted, all)) {
        fact->certified = 1;
        return write_answer(fact, wanted, wanted);
    }
    qs_vec u = careful_snap(shield, wanted, is_wanted, cuts, all, fact, &kind);
    fact->refused = kind != ACCEPTED;
    fact->stopped = kind == STOPPED || kind == ASTRAY;
    fact->certified = kind < ASTRAY && (is_outside || shield->rules.has_tube);
    fact->fallback |= kind == STOPPED || !fact->certified;
    fact->reserve /= shield->rules.u_max;
    return write_answer(fact, wanted, u);
}

/* ---- the shield and its settings ---- */

void qs_defaults(qs_settings *settings) {
    static const qs_settings defaults = {
        200, 3, INF, INF, 2, Q(0.005), 1, INF, Q(9.81), {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0}};
    if (settings) *settings = defaults;
}

int qs_init(qs_shield *shield, const qs_settings *settings) {
    if (!shield || !settings) return QS_BAD_POINTER;
    memset(shield, 0, sizeof *shield);
    int code = checked_settings(settings);
    shield->settings = *settings, shield->count = -1, shield->lag = told_lag(&settings->uncertainty);
    shield->is_ready = code == QS_DONE;
    return code;
}

int qs_prepare(qs_shield *shield, qs_real period) {
    if (!shield) return QS_BAD_POINTER;
    if (!shield->is_ready) return QS_BAD_SETTINGS;
    if (period == shield->rules.period) return QS_DONE;
    if (!(period >= EITHER(1e-9, 1e-4) && period <= 1)) return QS_BAD_PERIOD;
    const qs_settings *s = &shield->settings;
    qs_real most = s->snap_max * s->reserve;
    qs_limits limits = {
        s->held_snap_max, most, s->jerk_max, s->specific_thrust_min, s->specific_thrust_max, s->gravity};
    qs_rules rules = {0};
    rules.period = period, rules.limits = limits, rules.u_max = s->snap_max, rules.input_max = most;
    rules.gamma = -OF_REAL(expm1)(-s->alpha * period), rules.margin = s->margin;
    held_gains(4, TRACKING_POLE, period, rules.tracking);
    held_gains(3, BRAKING_POLE, period, rules.braking);
    held_gains(3, RECOVERY_POLE, period, rules.recovery);
    held_gains(4, EASING_POLE, period, rules.easing);
    rules.easing_left = -OF_REAL(expm1)(-EASING_POLE * period);
    rules.easing_within = (1 + SPARED * s->margin) / (1 + s->margin);
    int code = take_tube(s, period, &rules);
    if (code == QS_DONE) {
        shield->rules = rules;
        /* A stop is stored in whole periods: of another length it would be another stop. */
        shield->stop.is_stored = 0;
    }
    return code;
}

/* ---- the shield (shields.methods.tube_shield, on_the_way) ---- */

/* The state that the shield works on: when all that is on its way has been flown, and with a lag the lead. */
static void see(qs_shield *shield, const qs_real flat[4][3]) {
    const qs_uncertainty *told = &shield->settings.uncertainty;
    qs_state *x = &shield->last;
    memset(x, 0, sizeof *x);
    x->r = from3(flat[0]), x->v = from3(flat[1]), x->a = from3(flat[2]), x->j = from3(flat[3]);
    if (shield->lag > 0) take_lead(x, shield->lagged, shield->lag);
    shield->front = *x;
    for (int i = 0; i < told->delay; ++i)
        fly_on(&shield->last, shield->pending[i], shield->rules.period);
}

/* Move the stop and the snap behind the lag on to now; untold, the last answer was held for a period. */
static void carry(qs_shield *shield) {
    qs_real lag = shield->lag;
    if (isnan(shield->late)) shield->late = 0;
    if (shield->late != 0) shift_stop(&shield->stop, shield->rules.period, shield->late);
    if (lag > 0) {
        qs_real left = OF_REAL(exp)(-shield->followed / lag);
        shield->lagged = combined(shield->flown, left, subtract(shield->lagged, shield->flown));
    }
    shield->followed = 0; /* what has been followed once is not followed again */
}

/* The last answer, which may still be on its way. */
static qs_vec *newest(qs_shield *shield) {
    int delay = shield->settings.uncertainty.delay;
    return delay > 0 ? &shield->pending[delay - 1] : &shield->flown;
}

/* Without a measurement: the state that is to be expected. */
static void predict(qs_shield *shield) {
    carry(shield);
    fly_on(&shield->last, *newest(shield), (1 + shield->late) * shield->rules.period);
}

/* Put down what is flown until the next sample; send the answer behind those that are on their way. */
static void send(qs_shield *shield, qs_vec u) {
    int delay = shield->settings.uncertainty.delay;
    shield->flown = delay > 0 ? shield->pending[0] : u, shield->followed = shield->rules.period;
    for (int i = 0; i < delay; ++i) shield->pending[i] = i + 1 < delay ? shield->pending[i + 1] : u;
    shield->late = shield->settings.uncertainty.jitter > 0 ? ABSENT : 0;
}

/* Whether what is on its way keeps clear: of the whole distance, or where all of it was certified, no point of
 * its path lies in a body by more than errors do. */
static int is_way_clear(qs_shield *shield, const bodies *now, qs_real error) {
    int delay = shield->settings.uncertainty.delay, is_chained = shield->chain >= delay;
    qs_real lag = shield->lag, period = shield->rules.period;
    bodies kept_from = *now;
    qs_state x = shield->front;
    kept_from.keep = shield->bare;
    for (int k = 0; k < now->count; ++k)
        shield->bare[k] = !is_there(core_of(now, k), now->keep[k]) ? 0
                          : is_chained                             ? most_of(now->keep[k] - error, 0)
                                                                   : now->keep[k] + error;
    for (int i = 0; i < delay; ++i) {
        int found = look_at_arc(&x, shield->pending[i], i * period + lag, period, &kept_from, NULL);
        if (found == HIT || (found != CLEAR && !is_chained)) return 0;
        fly_on(&x, shield->pending[i], period);
    }
    return 1;
}

/* Withdraw the certificate where the vehicle is not where it has it; send the answer on its way. */
static void close_answer(qs_shield *shield, const qs_real flat[4][3], const qs_obstacle *body,
                         const bodies *all, qs_answer *fact) {
    qs_real error = shield->rules.estimate - shield->rules.tube;
    bodies now = *all;
    int is_here = 1;
    now.center = shield->center_now, now.keep = shield->stored;
    for (int k = 0; shield->rules.has_tube && k < all->count; ++k) {
        shield->center_now[k] = body[k].center, shield->stored[k] = body[k].radius;
        const qs_obstacle *core = core_of(all, k);
        qs_real distance = distance_from(core, subtract(from3(flat[0]), body[k].center));
        is_here &= !(is_there(core, body[k].radius) && distance < body[k].radius - error);
    }
    if (shield->settings.uncertainty.delay > 0) is_here = is_here && is_way_clear(shield, &now, error);
    send(shield, from3(fact->snap));
    if (fact->certified && !is_here) fact->certified = 0, fact->fallback = 1;
    shield->chain = fact->certified ? shield->chain + (shield->chain <= QS_MAX_DELAY) : 0;
}

/* The stored stop in place of an answer; without one the vehicle brakes. */
static qs_vec fly_stop(qs_shield *shield) {
    const qs_rules *rules = &shield->rules;
    const qs_state *x = &shield->last;
    qs_vec u;
    if (shield->stop.is_stored) {
        u = tracking_snap(&shield->stop, x, rules);
        shift_stop(&shield->stop, rules->period, 1);
    } else u = within_ball(braking(x->v, x->a, x->j, rules->braking), rules->limits.snap_max);
    return is_finite(u) ? u : NOTHING;
}

static int is_usable(const qs_real flat[4][3]) {
    for (int order = 0; order < 4; ++order)
        if (!is_below(from3(flat[order]), TOO_FAR)) return 0;
    return 1;
}

static int is_usable_body(const qs_obstacle *b) {
    int is_kind = b->kind >= QS_SPHERE && b->kind <= QS_HALF_SPACE;
    return is_kind && is_below(b->center, TOO_FAR) && is_below(b->velocity, TOO_FAR) && is_bound(b->radius) &&
           (b->kind != QS_HULL || (b->points && b->count > 0));
}

static int checked_call(qs_shield *shield, const qs_real flat[4][3], const qs_obstacle *body, int count,
                        const qs_real snap[3]) {
    if (!flat || !snap || (!body && count > 0)) return QS_BAD_POINTER;
    if (count < 0 || count > QS_MAX_OBSTACLES || (shield->count >= 0 && shield->count != count))
        return QS_BAD_COUNT;
    for (int k = 0; k < count; ++k)
        if (!is_usable_body(&body[k])) return QS_BAD_OBSTACLE;
    return is_usable(flat) ? QS_DONE : QS_BAD_STATE;
}

/* The answer to what cannot be filtered. */
static void answer_with_stop(qs_shield *shield, const qs_real flat[4][3], const qs_real snap[3],
                             qs_answer *answer) {
    if (flat && is_usable(flat)) {
        carry(shield);
        see(shield, flat);
    } else predict(shield);
    shield->before = shield->stop, shield->is_lost = 0;
    refuse(answer);
    answer->stopped = shield->stop.is_stored, shield->chain = 0;
    qs_vec u = fly_stop(shield);
    qs_real correction = snap ? norm(subtract(u, from3(snap))) : 0;
    write3(answer->snap, u);
    answer->correction = correction <= LARGEST ? correction : 0;
    send(shield, u);
}

/* The bodies as they are when the answer is flown, a lag later for the lead, at distances with the tube. */
static bodies bodies_ahead(qs_shield *shield, const qs_obstacle *body, int count) {
    const qs_uncertainty *told = &shield->settings.uncertainty;
    qs_real ahead = told->delay * shield->rules.period + shield->lag;
    bodies all = {count, 1, body, shield->center, shield->keep};
    for (int k = 0; k < count; ++k) all.are_spheres &= body[k].kind == QS_SPHERE;
    for (int k = 0; k < count; ++k) {
        int is_body = is_there(core_of(&all, k), body[k].radius);
        shield->center[k] = ahead > 0 ? combined(body[k].center, ahead, body[k].velocity) : body[k].center;
        shield->keep[k] = is_body ? body[k].radius + shield->rules.tube : 0;
    }
    return all;
}

int qs_filter(qs_shield *shield, const qs_real flat[4][3], const qs_obstacle *obstacles, int count,
              const qs_real snap[3], qs_real period, qs_answer *answer) {
    if (!answer) return QS_BAD_POINTER;
    refuse(answer);
    if (!shield) return QS_BAD_POINTER;
    if (!shield->is_ready) return QS_BAD_SETTINGS;
    int code = qs_prepare(shield, period);
    if (code == QS_DONE && isnan(shield->late)) code = QS_BAD_TIME;
    if (code == QS_DONE) code = checked_call(shield, flat, obstacles, count, snap);
    if (code != QS_DONE) {
        answer_with_stop(shield, flat, snap, answer);
        return code;
    }
    carry(shield);
    see(shield, flat);
    shield->count = count, shield->before = shield->stop, shield->is_lost = 0;
    bodies all = bodies_ahead(shield, obstacles, count);
    if (filter_row(shield, from3(snap), &all, answer)) {
        close_answer(shield, flat, obstacles, &all, answer);
        return QS_DONE;
    }
    shield->stop = shield->before;
    answer_with_stop(shield, flat, snap, answer);
    return QS_TOO_LARGE;
}

void qs_backup(qs_shield *shield, qs_real snap[3]) {
    qs_vec u = NOTHING;
    if (shield && shield->is_ready && shield->rules.period > 0) {
        int is_again = shield->is_lost;
        if (is_again) predict(shield);
        else shield->stop = shield->before;
        u = fly_stop(shield);
        if (is_again) send(shield, u);
        else *newest(shield) = u;
        shield->before = shield->stop, shield->is_lost = 1;
    }
    if (snap) write3(snap, u);
}

int qs_held_for(qs_shield *shield, qs_real seconds) {
    if (!shield) return QS_BAD_POINTER;
    if (!shield->is_ready || shield->settings.uncertainty.jitter == 0) return QS_BAD_SETTINGS;
    qs_real share = seconds / shield->rules.period;
    if (!(seconds > 0 && seconds <= 1 && share < INF)) return QS_BAD_TIME;
    shield->late = share - 1, shield->followed *= share;
    return QS_DONE;
}

/* ---- obstacles (quadsafe_core.shapes) ---- */

static qs_obstacle body_of(int kind, qs_vec center, qs_real radius, const qs_real velocity[3]) {
    qs_obstacle b = {0};
    b.kind = is_finite(center) && is_bound(radius) ? kind : QS_INVALID;
    b.center = center, b.radius = radius, b.velocity = velocity ? from3(velocity) : NOTHING;
    b.axes[0] = vec(1, 0, 0), b.axes[1] = vec(0, 1, 0), b.axes[2] = UP;
    return b;
}

/* Three axes of which the first is the unit vector e (Duff et al., JCGT 6(1), 2017). */
static void take_axis(qs_obstacle *b, qs_vec e) {
    qs_real s = COPYSIGN(1, e.z), a = -1 / (s + e.z);
    b->axes[0] = e;
    b->axes[1] = vec(1 + s * e.x * e.x * a, s * e.x * e.y * a, -s * e.x);
    b->axes[2] = vec(e.x * e.y * a, s + e.y * e.y * a, -e.y);
}

qs_obstacle qs_sphere(const qs_real center[3], qs_real radius, const qs_real velocity[3]) {
    return center ? body_of(QS_SPHERE, from3(center), radius, velocity) : body_of(QS_INVALID, NOTHING, 0, NULL);
}

static qs_obstacle between(int kind, const qs_real start[3], const qs_real end[3], qs_real radius,
                           const qs_real velocity[3]) {
    if (!start || !end) return body_of(QS_INVALID, NOTHING, 0, NULL);
    qs_vec half = over(subtract(from3(end), from3(start)), 2);
    qs_real length = norm(half);
    qs_obstacle b = body_of(kind, add(from3(start), half), radius, velocity);
    take_axis(&b, length > 0 ? over(half, length) : vec(1, 0, 0));
    b.half[0] = length;
    return b;
}

qs_obstacle qs_capsule(const qs_real start[3], const qs_real end[3], qs_real radius,
                       const qs_real velocity[3]) {
    return between(QS_CAPSULE, start, end, radius, velocity);
}

qs_obstacle qs_cylinder(const qs_real start[3], const qs_real end[3], qs_real radius,
                        const qs_real velocity[3]) {
    qs_obstacle b = between(QS_CYLINDER, start, end, radius, velocity);
    if (!(b.half[0] > 0)) b.kind = QS_INVALID;
    b.half[1] = b.radius, b.radius = 0;
    return b;
}

/* One Newton-Schulz step Q <- (3 - Q Q') Q / 2 where a matrix is a rotation but for few digits; 0 if not. */
static int orthonormal(qs_vec e[3]) {
    qs_real xx = dot(e[0], e[0]) - 1, yy = dot(e[1], e[1]) - 1, zz = dot(e[2], e[2]) - 1;
    qs_real xy = dot(e[0], e[1]), yz = dot(e[1], e[2]), zx = dot(e[2], e[0]);
    qs_real off = most_of(most_of(reach_of(vec(xx, yy, zz)), 0), reach_of(vec(xy, yz, zx)));
    qs_vec x = e[0], y = e[1], z = e[2];
    if (!(off <= EITHER(1e-9, 1e-5)) || dot(cross(x, y), z) < 0) return 0;
    if (off > EITHER(4e-15, 1e-6)) {
        e[0] = subtract(x, scale(Q(0.5), combined(combined(scale(xx, x), xy, y), zx, z)));
        e[1] = subtract(y, scale(Q(0.5), combined(combined(scale(xy, x), yy, y), yz, z)));
        e[2] = subtract(z, scale(Q(0.5), combined(combined(scale(zx, x), yz, y), zz, z)));
    }
    return 1;
}

qs_obstacle qs_box(const qs_real center[3], const qs_real size[3], const qs_real rotation[9],
                   const qs_real velocity[3]) {
    if (!center || !size) return body_of(QS_INVALID, NOTHING, 0, NULL);
    qs_obstacle b = body_of(QS_BOX, from3(center), 0, velocity);
    for (int i = 0; i < 3; ++i) {
        b.half[i] = size[i] / 2;
        if (rotation) b.axes[i] = vec(rotation[i], rotation[3 + i], rotation[6 + i]);
        if (!is_bound(size[i])) b.kind = QS_INVALID;
    }
    if (!orthonormal(b.axes)) b.kind = QS_INVALID;
    return b;
}

qs_obstacle qs_hull(const qs_real (*points)[3], int count, qs_real radius, const qs_real velocity[3]) {
    if (!points || count < 1) return body_of(QS_INVALID, NOTHING, 0, NULL);
    qs_vec low = from3(points[0]), high = low;
    int is_whole = 1;
    for (int i = 0; i < count; ++i) {
        qs_vec p = from3(points[i]);
        is_whole &= is_below(p, TOO_FAR);
        low = vec(least_of(low.x, p.x), least_of(low.y, p.y), least_of(low.z, p.z));
        high = vec(most_of(high.x, p.x), most_of(high.y, p.y), most_of(high.z, p.z));
    }
    qs_obstacle b =
        body_of(is_whole ? QS_HULL : QS_INVALID, add(over(low, 2), over(high, 2)), radius, velocity);
    b.points = points, b.count = count;
    for (int i = 0; i < count; ++i) b.half[0] = most_of(b.half[0], norm(vertex_of(&b, i)));
    return b;
}

qs_obstacle qs_half_space(const qs_real normal[3], qs_real offset) {
    qs_vec n = normal ? from3(normal) : NOTHING;
    qs_real length = norm(n);
    if (!(length > 0 && length < INF && ABS(offset) < TOO_FAR)) return body_of(QS_INVALID, NOTHING, 0, NULL);
    if (ABS(length - 1) > EITHER(4e-15, 1e-6)) n = over(n, length), offset /= length;
    qs_obstacle b = body_of(QS_HALF_SPACE, scale(offset, n), 0, NULL);
    take_axis(&b, n);
    return b;
}

/* ---- the flat map (quadsafe_env.vehicle.flatness) ----
 *
 * With t = a + g e3 = f_z z_B / m, in body axes:
 *
 *     jerk: ( f_z w_y, -f_z w_x, f_z' ) / m                                                            (31)
 */

enum { ATTITUDE = 6, OMEGA = 15, THRUST = 18, THRUST_RATE = 19, STATE = 20 };

static qs_real fused_dot(qs_vec a, qs_vec b) {
    return OF_REAL(fma)(a.x, b.x, OF_REAL(fma)(a.y, b.y, a.z * b.z));
}

static int is_body(const qs_real state[20], const qs_body *body) {
    for (int i = 0; i < STATE; ++i)
        if (!(ABS(state[i]) < TOO_FAR)) return 0;
    return is_positive(body->mass) && is_positive(body->inertia[0]) && is_positive(body->inertia[1]) &&
           is_positive(body->inertia[2]) && is_bound(body->gravity);
}

int qs_flat_state(const qs_real s[20], const qs_body *body, qs_real flat[4][3]) {
    if (!s || !body || !flat) return QS_BAD_POINTER;
    if (!is_body(s, body)) return QS_BAD_STATE;
    qs_real per_mass = 1 / body->mass, lift = s[THRUST] * per_mass;
    qs_vec j = vec(lift * s[OMEGA + 1], -lift * s[OMEGA], s[THRUST_RATE] * per_mass);
    for (int i = 0; i < 3; ++i) {
        const qs_real *row = s + ATTITUDE + 3 * i;
        flat[0][i] = s[i], flat[1][i] = s[3 + i];
        flat[2][i] = i < 2 ? lift * row[2] : OF_REAL(fma)(lift, row[2], -body->gravity);
        flat[3][i] = fused_dot(from3(row), j);
    }
    return QS_DONE;
}

int qs_wrench_from_snap(const qs_real s[20], const qs_real snap[3], qs_real yaw_acceleration,
                        const qs_body *body, qs_real wrench[4]) {
    if (!s || !snap || !body || !wrench) return QS_BAD_POINTER;
    if (!is_body(s, body) || !is_finite(from3(snap)) || !(ABS(yaw_acceleration) < INF) || !(s[THRUST] > 0))
        return QS_BAD_STATE;
    const qs_real *row = s + ATTITUDE, *J = body->inertia;
    qs_real x = s[OMEGA], y = s[OMEGA + 1], z = s[OMEGA + 2], m = body->mass, f = s[THRUST],
            df = s[THRUST_RATE];
    qs_real u[3], per_thrust = 1 / f;
    for (int i = 0; i < 3; ++i) u[i] = fused_dot(vec(row[i], row[3 + i], row[6 + i]), from3(snap));
    qs_real spin_x = OF_REAL(fma)(y, z, -OF_REAL(fma)(m, u[1], 2 * df * x) * per_thrust);
    qs_real spin_y = OF_REAL(fma)(-x, z, OF_REAL(fma)(m, u[0], -2 * df * y) * per_thrust);
    wrench[0] = OF_REAL(fma)(m, u[2], f * OF_REAL(fma)(x, x, y * y));
    wrench[1] = OF_REAL(fma)(J[0], spin_x, (J[2] - J[1]) * (y * z));
    wrench[2] = OF_REAL(fma)(J[1], spin_y, (J[0] - J[2]) * (z * x));
    wrench[3] = OF_REAL(fma)(J[2], yaw_acceleration, (J[1] - J[0]) * (x * y));
    return QS_DONE;
}
