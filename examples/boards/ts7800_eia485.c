/*
 * ts7800-eia485 set|clear|print [--mem FILE] [--cpuinfo FILE]: bit 15 of the register 0xE800000C of a TS-7800, which
 * switches a port between EIA-232 and EIA-485.
 *
 *   set, clear   the bit, by reading the register, changing this bit alone, and reading it back
 *   print        only reads
 *
 * It prints the register before and after. Exit status: 0 the bit is as wanted; 1 else, with the reason in one line on
 * stderr: nothing was written unless the line states it; 2 wrong arguments.
 *
 * On any board but a TS-7800 it refuses: /proc/cpuinfo must have the name that Linux gives the board, and the identity
 * register of its FPGA, 0xE8000000, must have the board's number 0x00B480. Nothing is mapped before the name is known.
 *
 * It needs root, and a kernel that lets /dev/mem reach the FPGA: with CONFIG_IO_STRICT_DEVMEM, as in Debian's kernels,
 * the parameter iomem=relaxed, because the kernel's own drivers use other registers in the same page. docs/boards.md
 * has the whole way.
 *
 * --mem and --cpuinfo: other files in place of /dev/mem and /proc/cpuinfo, for tests.
 *
 *   cc -O2 -Wall -Wextra -o ts7800-eia485 ts7800_eia485.c
 */
#define _FILE_OFFSET_BITS 64
#include <errno.h>
#include <fcntl.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/types.h>
#include <unistd.h>

#define FPGA		0xE8000000u
#define IDENTITY	0x00u
#define BOARD		0x00B480u	/* bits 8 to 31 of the identity; below it is the revision */
#define REGISTER	0x0Cu
#define BIT		(1u << 15)
#define HARDWARE	"Technologic Systems TS-78xx SBC"

static int refuse(const char *what, const char *why)
{
	fprintf(stderr, "%s: %s\n", what, why);
	return 1;
}

/* Whether /proc/cpuinfo has the board's name; -1 if it cannot be read. */
static int is_ts7800(const char *path)
{
	char line[256];
	int found = 0;
	FILE *file = fopen(path, "r");

	if (!file)
		return -1;
	while (fgets(line, sizeof(line), file)) {
		char *name = strchr(line, ':');

		if (strncmp(line, "Hardware", 8) || !name)
			continue;
		name += 1 + strspn(name + 1, " \t");
		name[strcspn(name, "\n")] = 0;
		found |= !strcmp(name, HARDWARE);
	}
	fclose(file);
	return found;
}

static int change(volatile uint32_t *fpga, const char *wish)
{
	uint32_t identity = fpga[IDENTITY / 4], before, after;

	if (identity >> 8 != BOARD) {
		fprintf(stderr, "0x%08X reads 0x%08X: not the FPGA of a TS-7800\n", FPGA, identity);
		return 1;
	}
	before = fpga[REGISTER / 4];
	printf("0x%08X: 0x%08X", FPGA + REGISTER, before);
	if (!strcmp(wish, "print")) {
		printf(", bit 15 is %d\n", !!(before & BIT));
		return 0;
	}
	fpga[REGISTER / 4] = strcmp(wish, "set") ? before & ~BIT : before | BIT;
	after = fpga[REGISTER / 4];
	printf(", now 0x%08X\n", after);
	if (!!(after & BIT) == !strcmp(wish, "set"))
		return 0;
	fflush(stdout);
	return refuse("written, but bit 15 does not keep it", wish);
}

int main(int argc, char **argv)
{
	const char *wish = NULL, *mem = "/dev/mem", *cpuinfo = "/proc/cpuinfo";
	long page = sysconf(_SC_PAGESIZE);
	int file, i, status, writes;
	void *fpga;

	for (i = 1; i < argc; i++) {
		if (!strcmp(argv[i], "--mem") && i + 1 < argc)
			mem = argv[++i];
		else if (!strcmp(argv[i], "--cpuinfo") && i + 1 < argc)
			cpuinfo = argv[++i];
		else if (!wish && (!strcmp(argv[i], "set") || !strcmp(argv[i], "clear") || !strcmp(argv[i], "print")))
			wish = argv[i];
		else
			wish = "";
	}
	if (!wish || !*wish) {
		fprintf(stderr, "usage: ts7800-eia485 set|clear|print [--mem FILE] [--cpuinfo FILE]\n");
		return 2;
	}

	status = is_ts7800(cpuinfo);
	if (status < 0)
		return refuse(cpuinfo, strerror(errno));
	if (!status)
		return refuse(cpuinfo, "this is not a TS-7800 (Hardware: " HARDWARE ")");

	writes = strcmp(wish, "print") != 0;
	file = open(mem, (writes ? O_RDWR : O_RDONLY) | O_SYNC | O_CLOEXEC);
	if (file < 0)
		return refuse(mem, strerror(errno));
	fpga = mmap(NULL, page, PROT_READ | (writes ? PROT_WRITE : 0), MAP_SHARED, file, (off_t)FPGA);
	close(file);
	if (fpga == MAP_FAILED) {
		if (errno == EPERM)
			return refuse(mem, "the kernel refuses 0xE8000000: needs root and iomem=relaxed");
		return refuse(mem, strerror(errno));
	}
	status = change(fpga, wish);
	munmap(fpga, page);
	return status;
}
