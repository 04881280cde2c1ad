"""Gives up, for the rest of a process, all that the system offers but computing and the open files (Linux)."""

from __future__ import annotations

import os
import sys
from errno import EPERM

# What an interpreter needs that computes, waits, and talks through files that are open already. What is not here fails:
# opening, writing and listing files, sockets, processes, signals, tracing.
_ALLOWED = (
    *("read", "readv", "pread64", "write", "writev", "close", "lseek", "fstat", "dup", "fcntl", "poll", "ppoll"),
    *("mmap", "munmap", "mprotect", "mremap", "madvise", "brk", "futex", "rseq", "set_robust_list", "membarrier"),
    *("rt_sigaction", "rt_sigprocmask", "rt_sigreturn", "sigaltstack", "restart_syscall"),
    *("clock_gettime", "clock_getres", "clock_nanosleep", "nanosleep", "gettimeofday", "time", "getrandom"),
    *("getpid", "gettid", "getuid", "geteuid", "getcwd", "getrusage", "sched_yield", "exit", "exit_group"),
)


def confine() -> bool:
    """Let this process compute and use its open files, and nothing else; there is no way back.

    System calls of any other kind fail with EPERM (seccomp, Linux on x86-64 and ARM64), and the environment is emptied.
    Import everything before.

    Returns:
        Whether the kernel sees to it; False on other systems, and where a container forbids it.
    """
    os.environ.clear()
    if not sys.platform.startswith("linux"):
        return False
    import seccompy

    try:
        allowed = seccompy.Filter(default=seccompy.Action.ERRNO | EPERM)
        for call in _ALLOWED:
            try:
                allowed.allow(call)
            except ValueError:  # one that this architecture does not have
                continue
        allowed.load()
    except seccompy.SeccompError:
        return False
    return True
