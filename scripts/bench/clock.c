// The process's own clock as the monotonic one: what measures itself by it measures processor time, on a busy machine too.
//     cc -O2 -shared -fPIC -o clock.so clock.c -ldl;  LD_PRELOAD=./clock.so PROGRAM
#define _GNU_SOURCE
#include <dlfcn.h>
#include <time.h>

int clock_gettime(clockid_t clock, struct timespec *now) {
    static int (*real)(clockid_t, struct timespec *);
    if (!real) real = (int (*)(clockid_t, struct timespec *))dlsym(RTLD_NEXT, "clock_gettime");
    return real(clock == CLOCK_MONOTONIC ? CLOCK_PROCESS_CPUTIME_ID : clock, now);
}
