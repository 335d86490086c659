/* Rows of what the tests ask of the C shield, its inner functions too: it is included whole. */
#include "../../c/quadsafe.c"

unsigned size_of_shield(void) { return sizeof(qs_shield); }
unsigned size_of_obstacle(void) { return sizeof(qs_obstacle); }
unsigned size_of_settings(void) { return sizeof(qs_settings); }
unsigned size_of_answer(void) { return sizeof(qs_answer); }

void lower4_rows(int n, const qs_real *x, const qs_real *u_max, qs_real *out)
{
    for (int i = 0; i < n; ++i, x += 4, out += 2) {
        lowest g = lower4(x[0], x[1], x[2], x[3], u_max[i]);
        out[0] = g.value, out[1] = g.time;
    }
}

/* held: period, gamma, reserve. */
void required4_rows(int n, const qs_real *x, const qs_real *wanted, const qs_real *u_max, const qs_real *bound,
                    const qs_real *held, qs_real *out)
{
    qs_rules rules = {0};
    rules.period = held[0];
    for (int i = 0; i < n; ++i, out += 3) {
        rules.u_max = u_max[i], rules.input_max = held[2] * u_max[i];
        required r = required4(x + 4 * i, bound[i], wanted[i], held[1], &rules);
        out[0] = r.least, out[1] = r.value, out[2] = r.is_admissible;
    }
}

void project_rows(int n, int count, const qs_real *u, const qs_half_space_of *planes, qs_real *out)
{
    for (int i = 0; i < n; ++i, out += 4) {
        qs_vec p = from3(u + 3 * i);
        out[3] = project(&p, planes + count * i, count);
        write3(out, p);
    }
}

/* Of one body: distance and direction away, nearest point, support height of a point as a direction. */
void shape_rows(int n, const qs_obstacle *body, const qs_real *x, qs_real *out)
{
    for (int i = 0; i < n; ++i, out += 8) {
        qs_vec away, gap = subtract(from3(x + 3 * i), body->center);
        out[0] = look_at(body, gap, &away);
        write3(out + 1, away);
        write3(out + 4, nearest_point(body, gap));
        out[7] = support_height(body, from3(x + 3 * i));
    }
}

void init_rows(int n, qs_shield *shields, const qs_settings *settings, int *codes)
{
    for (int i = 0; i < n; ++i)
        codes[i] = qs_init(&shields[i], settings);
}

/* Of shields with the same settings: a tube takes long, and what one has prepared serves all. */
void prepare_rows(int n, qs_shield *shields, qs_real period, int *codes)
{
    for (int i = 0; i < n; ++i) {
        if (i > 0 && codes[0] == QS_DONE && shields[i].rules.period != period)
            shields[i].rules = shields->rules, shields[i].stop.is_stored = 0;
        codes[i] = i > 0 && codes[0] != QS_DONE ? codes[0] : qs_prepare(&shields[i], period);
    }
}

void gains_of(const qs_shield *shield, qs_real *out)
{
    const qs_rules *r = &shield->rules;
    memcpy(out, r->tracking, sizeof r->tracking);
    memcpy(out + 4, r->braking, sizeof r->braking);
    memcpy(out + 7, r->recovery, sizeof r->recovery);
    memcpy(out + 10, r->easing, sizeof r->easing);
    qs_real rest[12] = {r->easing_left, r->easing_within, r->gamma, r->u_max, r->input_max, r->limits.snap_max,
                        r->limits.stop_snap_max, r->limits.jerk_max, r->limits.thrust_min, r->limits.thrust_max,
                        r->tube, r->estimate};
    memcpy(out + 14, rest, sizeof rest);
}

void take_gains(int n, qs_shield *shields, const qs_real *in)
{
    for (int i = 0; i < n; ++i) {
        qs_rules *r = &shields[i].rules;
        memcpy(r->tracking, in, sizeof r->tracking);
        memcpy(r->braking, in + 4, sizeof r->braking);
        memcpy(r->recovery, in + 7, sizeof r->recovery);
        memcpy(r->easing, in + 10, sizeof r->easing);
        r->easing_left = in[14], r->easing_within = in[15], r->gamma = in[16];
        r->limits.stop_snap_max = in[20], r->limits.jerk_max = in[21], r->limits.thrust_min = in[22];
        r->limits.thrust_max = in[23], r->tube = in[24], r->estimate = in[25];
    }
}

void filter_rows(int n, int count, qs_shield *shields, const qs_real *flats, const qs_obstacle *obstacles,
                 const qs_real *snaps, qs_real period, qs_answer *answers, int *codes)
{
    for (int i = 0; i < n; ++i)
        codes[i] = qs_filter(&shields[i], (const qs_real(*)[3])(flats + 12 * i), obstacles + count * i, count,
                             snaps + 3 * i, period, &answers[i]);
}

void backup_rows(int n, qs_shield *shields, const int *mask, qs_real *snaps)
{
    for (int i = 0; i < n; ++i)
        if (mask[i])
            qs_backup(&shields[i], snaps + 3 * i);
}

void held_rows(int n, qs_shield *shields, const qs_real *seconds, int *codes)
{
    for (int i = 0; i < n; ++i)
        codes[i] = qs_held_for(&shields[i], seconds[i]);
}

void flat_rows(int n, const qs_real *states, const qs_body *body, qs_real *out, int *codes)
{
    for (int i = 0; i < n; ++i)
        codes[i] = qs_flat_state(states + 20 * i, body, (qs_real(*)[3])(out + 12 * i));
}

void wrench_rows(int n, const qs_real *states, const qs_real *snaps, const qs_real *yaw, const qs_body *body,
                 qs_real *out, int *codes)
{
    for (int i = 0; i < n; ++i)
        codes[i] = qs_wrench_from_snap(states + 20 * i, snaps + 3 * i, yaw[i], body, out + 4 * i);
}
