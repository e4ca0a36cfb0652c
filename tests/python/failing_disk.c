/* A disk that fails: from the k-th change of a file on, calls that would change it return an error.
 * Preloaded into a test's process; only files whose path contains a given word are concerned.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <sys/types.h>
#include <unistd.h>

static char concerned[256];
static long changes, first, last;
static int number;

/* From the first-th change to the last-th one (counted from 1) fail with an errno. */
void fail_changes(const char *word, long from, long to, int with) {
    snprintf(concerned, sizeof concerned, "%s", word);
    changes = 0;
    first = from;
    last = to;
    number = with;
}

long count_changes(void) { return changes; }

static int fails_path(const char *path) {
    if (!concerned[0] || !strstr(path, concerned)) return 0;
    ++changes;
    if (changes < first || changes > last) return 0;
    errno = number;
    return 1;
}

static int fails(int fd) {
    char link[64], path[4096];
    if (!concerned[0]) return 0;
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t length = readlink(link, path, sizeof path - 1);
    if (length < 0) return 0;
    path[length] = 0;
    return fails_path(path);
}

#define REAL(type, name, ...) ((type(*)(__VA_ARGS__))dlsym(RTLD_NEXT, name))

ssize_t write(int fd, const void *data, size_t size) {
    return fails(fd) ? -1 : REAL(ssize_t, "write", int, const void *, size_t)(fd, data, size);
}

ssize_t pwrite(int fd, const void *data, size_t size, off_t at) {
    return fails(fd) ? -1 : REAL(ssize_t, "pwrite", int, const void *, size_t, off_t)(fd, data, size, at);
}

ssize_t pwrite64(int fd, const void *data, size_t size, off64_t at) {
    return fails(fd) ? -1 : REAL(ssize_t, "pwrite64", int, const void *, size_t, off64_t)(fd, data, size, at);
}

int ftruncate(int fd, off_t size) { return fails(fd) ? -1 : REAL(int, "ftruncate", int, off_t)(fd, size); }

int ftruncate64(int fd, off64_t size) {
    return fails(fd) ? -1 : REAL(int, "ftruncate64", int, off64_t)(fd, size);
}

int posix_fallocate(int fd, off_t at, off_t size) {
    return fails(fd) ? number : REAL(int, "posix_fallocate", int, off_t, off_t)(fd, at, size);
}

int posix_fallocate64(int fd, off64_t at, off64_t size) {
    return fails(fd) ? number : REAL(int, "posix_fallocate64", int, off64_t, off64_t)(fd, at, size);
}

int fsync(int fd) { return fails(fd) ? -1 : REAL(int, "fsync", int)(fd); }

int fdatasync(int fd) { return fails(fd) ? -1 : REAL(int, "fdatasync", int)(fd); }

int rename(const char *from, const char *to) {
    return fails_path(to) ? -1 : REAL(int, "rename", const char *, const char *)(from, to);
}

int open(const char *path, int flags, ...) {
    va_list rest;
    va_start(rest, flags);
    mode_t mode = flags & O_CREAT ? va_arg(rest, mode_t) : 0;
    va_end(rest);
    if ((flags & O_CREAT) && access(path, F_OK) != 0 && fails_path(path)) return -1;
    return REAL(int, "open", const char *, int, ...)(path, flags, mode);
}

int open64(const char *path, int flags, ...) {
    va_list rest;
    va_start(rest, flags);
    mode_t mode = flags & O_CREAT ? va_arg(rest, mode_t) : 0;
    va_end(rest);
    if ((flags & O_CREAT) && access(path, F_OK) != 0 && fails_path(path)) return -1;
    return REAL(int, "open64", const char *, int, ...)(path, flags, mode);
}
