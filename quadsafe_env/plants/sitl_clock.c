/* The clock of a Betaflight SITL in the hands of who flies it: loaded before libc, it stands in the place of the
 * wall clock. Time moves when the firmware's main loop sleeps, and a little whenever that looks; at the end of what was
 * granted the loop waits for the next grant. A grant is two int64 on descriptor GRANTS: nanoseconds, and how many
 * datagrams must have been taken in before. A byte on descriptor SPENT says that the loop waits. No more grants: it ends.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <pthread.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/select.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#define LOOK 250 /* ns that pass when the main loop looks at the clock, or its waits by looking would never end */

static int64_t now, limit, taken;
static int grants, spent;
static __thread int is_main, took;
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static pthread_cond_t news = PTHREAD_COND_INITIALIZER;

static int (*real_clock)(clockid_t, struct timespec *);
static int (*real_sleep)(const struct timespec *, struct timespec *);
static int (*real_select)(int, fd_set *, fd_set *, fd_set *, struct timeval *);
static ssize_t (*real_recvfrom)(int, void *, size_t, int, struct sockaddr *, socklen_t *);

__attribute__((constructor)) static void begin(void)
{
    real_clock = dlsym(RTLD_NEXT, "clock_gettime");
    real_sleep = dlsym(RTLD_NEXT, "nanosleep");
    real_select = dlsym(RTLD_NEXT, "select");
    real_recvfrom = dlsym(RTLD_NEXT, "recvfrom");
    is_main = 1;
    grants = atoi(getenv("GRANTS"));
    spent = atoi(getenv("SPENT"));
}

static void wait_for_grant(void)
{
    int64_t grant[2];
    if (write(spent, "", 1) != 1 || read(grants, grant, sizeof grant) != sizeof grant) _exit(0);
    pthread_mutex_lock(&lock);
    while (taken < grant[1]) pthread_cond_wait(&news, &lock);
    pthread_mutex_unlock(&lock);
    __atomic_store_n(&limit, limit + grant[0], __ATOMIC_SEQ_CST);
}

int clock_gettime(clockid_t clock, struct timespec *time)
{
    if (clock != CLOCK_MONOTONIC) return real_clock(clock, time);
    int64_t seen = is_main ? (now += LOOK) : __atomic_load_n(&limit, __ATOMIC_SEQ_CST);
    time->tv_sec = seen / 1000000000;
    time->tv_nsec = seen % 1000000000;
    return 0;
}

int nanosleep(const struct timespec *asked, struct timespec *left)
{
    if (!is_main) return real_sleep(asked, left);
    now += asked->tv_sec * 1000000000LL + asked->tv_nsec;
    while (now >= limit) wait_for_grant();
    return 0;
}

ssize_t recvfrom(int socket, void *data, size_t size, int flags, struct sockaddr *from, socklen_t *length)
{
    ssize_t got = real_recvfrom(socket, data, size, flags, from, length);
    took = got > 0;
    return got;
}

/* A thread that waits for the next datagram is done with the one before. */
int select(int count, fd_set *in, fd_set *out, fd_set *odd, struct timeval *timeout)
{
    if (took) {
        took = 0;
        pthread_mutex_lock(&lock);
        taken++;
        pthread_cond_broadcast(&news);
        pthread_mutex_unlock(&lock);
    }
    return real_select(count, in, out, odd, timeout);
}
