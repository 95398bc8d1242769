// SPDX-License-Identifier: BSD-3-Clause
// Preloaded into quell by the tests: QUELL_FAULT = WHAT:K does WHAT at the K-th call that makes, writes or renames a
// temporary file of ours (*.part).
//   signal2, signal15 ...  raise that signal before the call
//   nospace                the call, if it writes, and all later ones fail with ENOSPC
//   rename                 the K-th renaming fails with ENOSPC
//   moment2, moment15 ...  raise that signal before the K-th allocation while the program handles it, on whatever
//   thread
//                          that is; with WHAT:K:L again before the L-th
// QUELL_FAULT_COUNT = FILE: how many allocations those were, at the end.
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/uio.h>
#include <unistd.h>

static atomic_int calls;

// Of the allocations: all that needs looking up is looked up before the program begins.
static atomic_long allocations;
static atomic_int handled;
static long moments[2];
static int moment_signal;
void* __libc_malloc(size_t);
void* __libc_calloc(size_t, size_t);

__attribute__((constructor)) static void begin(void)
{
  const char* fault = getenv("QUELL_FAULT");
  int signal_number;
  long first, second = 0;
  if (fault && sscanf(fault, "moment%d:%ld:%ld", &signal_number, &first, &second) >= 2)
  {
    moments[0] = first;
    moments[1] = second;
    moment_signal = signal_number;
  }
}

__attribute__((destructor)) static void end(void)
{
  const char* file = getenv("QUELL_FAULT_COUNT");
  FILE* out = file ? fopen(file, "w") : NULL;
  if (out)
  {
    fprintf(out, "%ld\n", atomic_load(&allocations));
    fclose(out);
  }
}

static void moment(void)
{
  if (!atomic_load_explicit(&handled, memory_order_relaxed))
    return;
  const long now = atomic_fetch_add(&allocations, 1) + 1;
  if (moment_signal && (now == moments[0] || now == moments[1]))
    raise(moment_signal);
}

void* malloc(size_t size)
{
  moment();
  return __libc_malloc(size);
}

void* calloc(size_t count, size_t size)
{
  moment();
  return __libc_calloc(count, size);
}

typedef void (*handler)(int);
handler signal(int number, handler what)
{
  static handler (*real)(int, handler);
  if (!real)
    *(void**)&real = dlsym(RTLD_NEXT, "signal");
  const handler before = real(number, what);
  if (number == SIGTERM)
    atomic_store(&handled, what != SIG_DFL && what != SIG_IGN);
  return before;
}

static int is_part(const char* path)
{
  const size_t n = path ? strlen(path) : 0;
  return n > 5 && strcmp(path + n - 5, ".part") == 0;
}

static int is_part_file(int fd)
{
  char link[64], path[PATH_MAX];
  snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
  const ssize_t n = readlink(link, path, sizeof path - 1);
  if (n <= 0)
    return 0;
  path[n] = '\0';
  return is_part(path);
}

enum kind
{
  making,
  writing,
  renaming
};

// True: the call has to fail.
static int event(enum kind kind)
{
  const char* fault = getenv("QUELL_FAULT");
  const char* colon = fault ? strchr(fault, ':') : NULL;
  if (!colon)
    return 0;
  const int k = atoi(colon + 1);
  if (strncmp(fault, "rename", 6) == 0)
    return kind == renaming && atomic_fetch_add(&calls, 1) + 1 == k;
  const int now = atomic_fetch_add(&calls, 1) + 1;
  if (strncmp(fault, "nospace", 7) == 0)
    return kind == writing && now >= k;
  if (now == k && strncmp(fault, "signal", 6) == 0)
    raise(atoi(fault + 6));
  return 0;
}

ssize_t write(int fd, const void* data, size_t size)
{
  static ssize_t (*real)(int, const void*, size_t);
  if (!real)
    *(void**)&real = dlsym(RTLD_NEXT, "write");
  if (is_part_file(fd) && event(writing))
  {
    errno = ENOSPC;
    return -1;
  }
  return real(fd, data, size);
}

ssize_t writev(int fd, const struct iovec* parts, int count)
{
  static ssize_t (*real)(int, const struct iovec*, int);
  if (!real)
    *(void**)&real = dlsym(RTLD_NEXT, "writev");
  if (is_part_file(fd) && event(writing))
  {
    errno = ENOSPC;
    return -1;
  }
  return real(fd, parts, count);
}

ssize_t pwrite(int fd, const void* data, size_t size, off_t at)
{
  static ssize_t (*real)(int, const void*, size_t, off_t);
  if (!real)
    *(void**)&real = dlsym(RTLD_NEXT, "pwrite");
  if (is_part_file(fd) && event(writing))
  {
    errno = ENOSPC;
    return -1;
  }
  return real(fd, data, size, at);
}

ssize_t pwrite64(int fd, const void* data, size_t size, off64_t at)
{
  return pwrite(fd, data, size, at);
}

int rename(const char* from, const char* to)
{
  static int (*real)(const char*, const char*);
  if (!real)
    *(void**)&real = dlsym(RTLD_NEXT, "rename");
  if (is_part(from) && event(renaming))
  {
    errno = ENOSPC;
    return -1;
  }
  return real(from, to);
}

int open(const char* path, int flags, ...)
{
  static int (*real)(const char*, int, ...);
  if (!real)
    *(void**)&real = dlsym(RTLD_NEXT, "open");
  mode_t mode = 0;
  if (flags & (O_CREAT | O_TMPFILE))
  {
    va_list rest;
    va_start(rest, flags);
    mode = va_arg(rest, mode_t);
    va_end(rest);
  }
  if (is_part(path))
    event(making);
  return real(path, flags, mode);
}
