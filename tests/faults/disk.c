/* Faults of a disk, below one folder: put before the C library by LD_PRELOAD.
 *
 * Every call that changes the folder is a step. At a chosen step the process is killed, interrupted,
 * or told that the disk is broken; or the disk is full after a number of bytes. Every step can be
 * written to a log, with the content of each file at its fsync: from these a test builds what a power
 * cut would leave of the folder.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

enum { NOTHING, KILL, INTERRUPT, BROKEN, FULL };

static char under[PATH_MAX], logged[PATH_MAX];
static size_t length;
static int kind, quiet;

/* Counted together with the processes that a command makes of itself. */
static struct {
    long at, count, blobs;
    char trace[1 << 16];
} *steps;

#define REAL(name) static __typeof__(name) *real; if (!real) *(void **)&real = dlsym(RTLD_NEXT, #name)

/* Count steps below a folder; `kind` happens at step `at` (of FULL: after so many bytes). */
void disk_arm(const char *folder, int what, long when, const char *log)
{
    snprintf(under, sizeof under, "%s", folder);
    snprintf(logged, sizeof logged, "%s", log ? log : "");
    length = strlen(under);
    kind = what;
    if (!steps) {
        steps = mmap(0, sizeof *steps, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
        if (steps == MAP_FAILED)
            abort();
    }
    memset(steps, 0, sizeof *steps);
    steps->at = when;
}

/* A letter for every step so far. */
const char *disk_trace(void)
{
    steps->trace[sizeof steps->trace - 1] = 0; /* behind the last step there are zeros */
    return steps->trace;
}

static int is_below(const char *path)
{
    return !strncmp(path, under, length) && (path[length] == '/' || !path[length]);
}

/* Absolute path of a name in a folder that is open; 0 if it is not below. */
static int resolved(int folder, const char *name, char *path)
{
    char base[PATH_MAX];
    if (!length || quiet)
        return 0;
    if (name[0] == '/')
        snprintf(path, PATH_MAX, "%s", name);
    else {
        char link[64];
        ssize_t n;
        if (folder == AT_FDCWD)
            snprintf(link, sizeof link, "/proc/self/cwd");
        else
            snprintf(link, sizeof link, "/proc/self/fd/%d", folder);
        n = readlink(link, base, sizeof base - 1);
        if (n < 0)
            return 0;
        base[n] = 0;
        if (snprintf(path, PATH_MAX, name[0] ? "%s/%s" : "%s", base, name) >= PATH_MAX)
            return 0;
    }
    return is_below(path);
}

static int opened(int number, char *path)
{
    return resolved(number, "", path);
}

/* One step; an error number if it fails. */
static int step(char letter, long bytes)
{
    long now = __atomic_fetch_add(&steps->count, 1, __ATOMIC_RELAXED);
    if (now < (long)sizeof steps->trace - 1)
        steps->trace[now] = letter;
    if (kind == KILL && now == steps->at)
        kill(getpid(), SIGKILL);
    if (kind == INTERRUPT && now == steps->at)
        kill(getpid(), SIGINT);
    if (kind == BROKEN && now == steps->at)
        return EIO;
    if (kind == FULL && strchr("CMLW", letter)) {
        steps->at -= bytes;
        if (steps->at < 0)
            return ENOSPC;
    }
    return 0;
}

static void note(const char *format, ...)
{
    char line[3 * PATH_MAX], file[PATH_MAX + 8];
    va_list arguments;
    int number, n;
    if (!*logged)
        return;
    va_start(arguments, format);
    n = vsnprintf(line, sizeof line, format, arguments);
    va_end(arguments);
    quiet = 1;
    snprintf(file, sizeof file, "%s/log", logged);
    number = open(file, O_WRONLY | O_CREAT | O_APPEND, 0600);
    if (number >= 0) {
        if (write(number, line, n) != n)
            abort();
        close(number);
    }
    quiet = 0;
}

static unsigned long inode(const char *path)
{
    struct stat about;
    return lstat(path, &about) ? 0 : (unsigned long)about.st_ino;
}

/* Keep what a file holds when it has been told to be on the disk. */
static void keep(const char *path)
{
    char file[PATH_MAX + 32], buffer[1 << 16];
    int from, to;
    ssize_t n;
    if (!*logged)
        return;
    quiet = 1;
    snprintf(file, sizeof file, "%s/%ld", logged, steps->blobs);
    from = open(path, O_RDONLY);
    to = open(file, O_WRONLY | O_CREAT | O_TRUNC, 0600);
    while ((n = read(from, buffer, sizeof buffer)) > 0)
        if (write(to, buffer, n) != n)
            abort();
    close(from);
    close(to);
    quiet = 0;
    note("S\t%lu\t%ld\n", inode(path), steps->blobs++);
}

static int opening(int folder, const char *name, int flags, mode_t mode)
{
    REAL(openat);
    char path[PATH_MAX];
    int fresh, error, number;
    if (!(flags & (O_CREAT | O_TRUNC)) || !resolved(folder, name, path))
        return real(folder, name, flags, mode);
    fresh = !inode(path);
    if (!fresh && !(flags & O_TRUNC))
        return real(folder, name, flags, mode);
    error = step(fresh ? 'C' : 'T', 1);
    if (error) {
        errno = error;
        return -1;
    }
    number = real(folder, name, flags, mode);
    if (number >= 0 && fresh)
        note("C\t%lu\t%s\n", inode(path), path);
    return number;
}

#define MODE mode_t mode = 0; if (flags & (O_CREAT | O_TMPFILE)) { \
    va_list a; va_start(a, flags); mode = va_arg(a, mode_t); va_end(a); }

int open(const char *name, int flags, ...) { MODE return opening(AT_FDCWD, name, flags, mode); }
int open64(const char *name, int flags, ...) { MODE return opening(AT_FDCWD, name, flags, mode); }
int openat(int folder, const char *name, int flags, ...) { MODE return opening(folder, name, flags, mode); }
int openat64(int folder, const char *name, int flags, ...) { MODE return opening(folder, name, flags, mode); }
int creat(const char *name, mode_t mode) { return opening(AT_FDCWD, name, O_CREAT | O_WRONLY | O_TRUNC, mode); }

/* Bytes that may be written; -1 and errno if none. */
static ssize_t allowed(int number, size_t size)
{
    char path[PATH_MAX];
    long left = steps ? steps->at : 0;
    int error;
    if (!opened(number, path))
        return size;
    error = step('W', size);
    if (!error)
        return size;
    if (error == ENOSPC && left > 0)
        return left; /* what fits; the next one does not */
    errno = error;
    return -1;
}

ssize_t write(int number, const void *from, size_t size)
{
    REAL(write);
    ssize_t n = allowed(number, size);
    return n < 0 ? n : real(number, from, n);
}

ssize_t pwrite64(int number, const void *from, size_t size, off64_t place)
{
    REAL(pwrite64);
    ssize_t n = allowed(number, size);
    return n < 0 ? n : real(number, from, n, place);
}

ssize_t pwrite(int number, const void *from, size_t size, off_t place) { return pwrite64(number, from, size, place); }

ssize_t writev(int number, const struct iovec *parts, int n)
{
    REAL(writev);
    size_t size = 0;
    ssize_t all;
    for (int k = 0; k < n; k++)
        size += parts[k].iov_len;
    all = allowed(number, size);
    if (all < 0)
        return all;
    return (size_t)all == size ? real(number, parts, n) : write(number, parts[0].iov_base, 0);
}

static int synced(int number, int (*real)(int))
{
    char path[PATH_MAX];
    struct stat about;
    int error;
    if (!opened(number, path))
        return real(number);
    error = step('S', 0);
    if (error) {
        errno = error;
        return -1;
    }
    /* Nothing waits for the disk: power is not cut in earnest. */
    if (!fstat(number, &about) && S_ISDIR(about.st_mode))
        note("N\t%s\n", path);
    else
        keep(path);
    return 0;
}

int fsync(int number) { REAL(fsync); return synced(number, real); }
int fdatasync(int number) { REAL(fdatasync); return synced(number, real); }

int renameat2(int a, const char *from, int b, const char *to, unsigned flags)
{
    REAL(renameat2);
    char one[PATH_MAX], two[PATH_MAX];
    int error, result;
    if (!resolved(a, from, one) || !resolved(b, to, two))
        return real(a, from, b, to, flags);
    error = step('R', 0);
    if (error) {
        errno = error;
        return -1;
    }
    int same = inode(one) == inode(two); /* two names of one file: nothing happens */
    result = real(a, from, b, to, flags);
    if (!result && !same)
        note("R\t%s\t%s\n", one, two);
    return result;
}

int rename(const char *from, const char *to) { return renameat2(AT_FDCWD, from, AT_FDCWD, to, 0); }
int renameat(int a, const char *from, int b, const char *to) { return renameat2(a, from, b, to, 0); }

int linkat(int a, const char *from, int b, const char *to, int flags)
{
    REAL(linkat);
    char one[PATH_MAX], two[PATH_MAX];
    int error, result;
    if (!resolved(a, from, one) || !resolved(b, to, two))
        return real(a, from, b, to, flags);
    error = step('L', 1);
    if (error) {
        errno = error;
        return -1;
    }
    result = real(a, from, b, to, flags);
    if (!result)
        note("L\t%s\t%s\n", one, two);
    return result;
}

int link(const char *from, const char *to) { return linkat(AT_FDCWD, from, AT_FDCWD, to, 0); }

int unlinkat(int folder, const char *name, int flags)
{
    REAL(unlinkat);
    char path[PATH_MAX];
    int error, result;
    if (!resolved(folder, name, path) || !inode(path))
        return real(folder, name, flags);
    error = step('U', 0);
    if (error) {
        errno = error;
        return -1;
    }
    result = real(folder, name, flags);
    if (!result)
        note("U\t%s\n", path);
    return result;
}

int unlink(const char *name) { return unlinkat(AT_FDCWD, name, 0); }
int rmdir(const char *name) { return unlinkat(AT_FDCWD, name, AT_REMOVEDIR); }

int mkdirat(int folder, const char *name, mode_t mode)
{
    REAL(mkdirat);
    char path[PATH_MAX];
    int error, result;
    if (!resolved(folder, name, path) || inode(path))
        return real(folder, name, mode);
    error = step('M', 1);
    if (error) {
        errno = error;
        return -1;
    }
    result = real(folder, name, mode);
    if (!result)
        note("M\t%s\n", path);
    return result;
}

int mkdir(const char *name, mode_t mode) { return mkdirat(AT_FDCWD, name, mode); }
