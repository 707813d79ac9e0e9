/* The same message through the code that the official lcm-gen writes. Reads a letter, answers with ns per message. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "advee_range_scan_t.h"

enum { ROUND = 20000 };

static unsigned char buffer[512];
static volatile int sink;

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1e9 + t.tv_nsec;
}

int main(void)
{
    advee_range_scan_t scan, read;
    scan.utime = 1321867200123456;
    scan.sensor = "HOKUYO_FRONT";
    for (int i = 0; i < 16; i++) {
        scan.ranges[i].distance = 0.25 * i;
        scan.ranges[i].bearing = -1.5 + 0.2 * i;
        scan.ranges[i].status = (int8_t) (i - 8);
    }
    int size = advee_range_scan_t_encode(buffer, 0, sizeof buffer, &scan);
    for (int i = 0; i < size; i++) printf("%02x", buffer[i]);
    printf("\n");
    fflush(stdout);

    for (int what; (what = getchar()) != EOF;) {
        double begin = now();
        for (int i = 0; i < ROUND; i++) {
            scan.utime = i;
            switch (what) {
            case 'e': sink = advee_range_scan_t_encode(buffer, 0, sizeof buffer, &scan); break;
            case 'm': {
                int needed = advee_range_scan_t_encoded_size(&scan);
                void *out = malloc(needed);
                sink = advee_range_scan_t_encode(out, 0, needed, &scan);
                free(out);
                break;
            }
            case 'd':
                sink = advee_range_scan_t_decode(buffer, 0, size, &read);
                advee_range_scan_t_decode_cleanup(&read);
                break;
            }
        }
        printf("%f\n", (now() - begin) / ROUND);
        fflush(stdout);
    }
    return 0;
}
