// Makes the process of a module fail, without a hook in the program: loaded by LD_PRELOAD, it waits for a signal and
// then disturbs the main loop, or a thread beside it, as a bug would. Used by benches/faults.rs, which has the same
// table.
#define _GNU_SOURCE
#include <arpa/inet.h>
#include <fcntl.h>
#include <pthread.h>
#include <semaphore.h>
#include <signal.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

enum { BUSY = SIGUSR1, WORKER = SIGUSR2, BUS = SIGURG, DISK = SIGVTALRM, MEMORY = SIGPROF, DESCRIPTORS = SIGWINCH,
       LOG = SIGIO };

// Size of an allocation of the memory hog, and their maximum number, in case there is no limit.
enum { STEP = 1 << 20, STEPS = 2048 };
// Duration of the shortage of descriptors and of the flood of the log; maximum number of descriptors.
enum { LASTS_MS = 2000, DESCRIPTORS_MAX = 512 };

static sem_t wanted;
static volatile int kind;
static volatile int worker_deadlocks;
static pthread_mutex_t work = PTHREAD_MUTEX_INITIALIZER;

static void sleep_ms(long ms) {
    struct timespec time = {ms / 1000, ms % 1000 * 1000000};
    nanosleep(&time, NULL);
}

static int64_t now_ms(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * 1000LL + now.tv_nsec / 1000000;
}

// In the main loop: none of these returns.
static void hang(int how) {
    if (how == BUS) {
        // An answer that never arrives.
        struct sockaddr_in nobody = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
        int line = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
        bind(line, (struct sockaddr *)&nobody, sizeof nobody);
        for (char byte;;) recv(line, &byte, 1, 0);
    }
    if (how == DISK) {
        // A file that cannot be opened: there is no process at the other end.
        const char *path = getenv("ADVEE_SABOTAGE");
        mkfifo(path, 0600);
        for (;;) open(path, O_WRONLY | O_CLOEXEC);
    }
    for (volatile unsigned turns = 0;; turns++) {
    }
}

static void on_signal(int signal) {
    switch (signal) {
    case WORKER: worker_deadlocks = 1; break;
    case MEMORY: case DESCRIPTORS: case LOG: kind = signal; sem_post(&wanted); break;
    default: hang(signal);
    }
}

static void take_memory(void) {
    for (int step = 0; step < STEPS; step++) {
        void *part = mmap(NULL, STEP, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
        // A Rust program aborts when memory is refused.
        if (part == MAP_FAILED) abort();
        memset(part, 0xA5, STEP);
        if (step % 4 == 3) sleep_ms(1);
    }
}

static void take_descriptors(void) {
    static int taken[DESCRIPTORS_MAX];
    struct rlimit before, few;
    getrlimit(RLIMIT_NOFILE, &before);
    few = before;
    if (few.rlim_cur > DESCRIPTORS_MAX) few.rlim_cur = DESCRIPTORS_MAX;
    setrlimit(RLIMIT_NOFILE, &few);
    int count = 0;
    while (count < DESCRIPTORS_MAX && (taken[count] = open("/dev/null", O_RDONLY | O_CLOEXEC)) >= 0) count++;
    sleep_ms(LASTS_MS);
    while (count > 0) close(taken[--count]);
    setrlimit(RLIMIT_NOFILE, &before);
}

static void flood_log(void) {
    static const char line[] = "00:00:00.000 saboteur WARNING: the same again, and again, and again, and again\n";
    for (int64_t until = now_ms() + LASTS_MS; now_ms() < until;)
        if (write(STDERR_FILENO, line, sizeof line - 1) < 0) return;
}

static void *beside(void *unused) {
    (void)unused;
    for (;;) {
        while (sem_wait(&wanted) != 0) {
        }
        switch (kind) {
        case MEMORY: take_memory(); break;
        case DESCRIPTORS: take_descriptors(); break;
        default: flood_log();
        }
    }
    return NULL;
}

// A worker with a heartbeat beside the main loop (docs/beats.md), which can deadlock while the main loop works.
static void *worker(void *path) {
    int page = open(path, O_RDWR | O_CLOEXEC);
    uint32_t head[4] = {0};
    if (page < 0) return NULL;
    while (pread(page, head, sizeof head, 0) != sizeof head || head[2] != (uint32_t)getpid()) sleep_ms(5);
    struct { char name[48]; uint32_t count, zero[3]; } entry = {.name = "worker", .count = 1};
    off_t place = 64 + 64 * (off_t)head[3];
    pwrite(page, &entry, sizeof entry, place);
    head[3]++;
    pwrite(page, &head[3], 4, 12);
    for (;;) {
        pthread_mutex_lock(&work);
        if (worker_deadlocks) pthread_mutex_lock(&work);
        entry.count++;
        pwrite(page, &entry.count, 4, place + 48);
        pthread_mutex_unlock(&work);
        sleep_ms(40);
    }
}

__attribute__((constructor)) static void begin(int argc, char **argv) {
    static const int signals[] = {BUSY, WORKER, BUS, DISK, MEMORY, DESCRIPTORS, LOG};
    if (argc < 2 || strstr(argv[0], "advee") == NULL) return;
    // Modules only, not their parent.
    int is_module = 0;
    for (int i = 1; i < argc; i++) is_module |= strcmp(argv[i], "run") == 0;
    if (!is_module) return;
    // Its threads block all signals, which are for the main loop.
    sigset_t all, before;
    sigfillset(&all);
    pthread_sigmask(SIG_BLOCK, &all, &before);
    pthread_t thread;
    sem_init(&wanted, 0, 0);
    pthread_create(&thread, NULL, beside, NULL);
    char *beats = getenv("ADVEE_BEATS");
    if (beats != NULL) pthread_create(&thread, NULL, worker, beats);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    struct sigaction action = {.sa_handler = on_signal, .sa_flags = SA_RESTART};
    for (unsigned i = 0; i < sizeof signals / sizeof *signals; i++) sigaction(signals[i], &action, NULL);
}
