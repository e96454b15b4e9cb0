"""Filters of system calls for confined processes; what they start is filtered too, for ever.

A process that only computes has a short list of calls that are allowed. Programs need too many calls for such a list,
so the other filters list what is refused: the network, other processes, the kernel's administration, and what Landlock
does not cover (owners, modes, times of files). Refused calls fail with EPERM.

Source: the kernel's documentation of seccomp filters; numbers from its unistd headers.
"""

from __future__ import annotations

import ctypes
import errno
import os
import platform
import socket
from collections.abc import Sequence

from dohyo.service.confinement.tasks import Rights

# Calls for memory, time, and open pipes. Numbers on x86-64 and aarch64.
ALLOWED = {
    "read": (0, 63),
    "readv": (19, 65),
    "write": (1, 64),
    "close": (3, 57),
    "fstat": (5, 80),
    "mmap": (9, 222),
    "mprotect": (10, 226),
    "munmap": (11, 215),
    "brk": (12, 214),
    "rt_sigaction": (13, 134),
    "rt_sigprocmask": (14, 135),
    "rt_sigreturn": (15, 139),
    "sched_yield": (24, 124),
    "mremap": (25, 216),
    "madvise": (28, 233),
    "nanosleep": (35, 101),
    "setitimer": (38, 103),
    "getpid": (39, 172),
    "exit": (60, 93),
    "gettimeofday": (96, 169),
    "sigaltstack": (131, 132),
    "gettid": (186, 178),
    "futex": (202, 98),
    "sched_getaffinity": (204, 123),
    "restart_syscall": (219, 128),
    "clock_gettime": (228, 113),
    "clock_nanosleep": (230, 115),
    "exit_group": (231, 94),
    "getcpu": (309, 168),
    "getrandom": (318, 278),
}
# Refused where files may be opened; None: the machine has no such call.
NETWORK = {
    "socket": (41, 198),
    "connect": (42, 203),
    "accept": (43, 202),
    "bind": (49, 200),
    "listen": (50, 201),
    "accept4": (288, 242),
    "io_uring_setup": (425, 425),  # its operations pass by every filter
    "io_uring_enter": (426, 426),
    "io_uring_register": (427, 427),
}
OTHER_PROCESSES = {
    "ptrace": (101, 117),
    "process_vm_readv": (310, 270),
    "process_vm_writev": (311, 271),
    "kcmp": (312, 272),
    "tkill": (200, 130),
    "rt_sigqueueinfo": (129, 138),
    "rt_tgsigqueueinfo": (297, 240),
    "pidfd_send_signal": (424, 424),
    "pidfd_open": (434, 434),
    "pidfd_getfd": (438, 438),
    "process_madvise": (440, 440),
    "process_mrelease": (448, 448),
    "migrate_pages": (256, 238),
    "move_pages": (279, 239),
    "setpriority": (141, 140),
    "ioprio_set": (251, 30),
    "sched_setparam": (142, 118),
    "sched_setscheduler": (144, 119),
    "sched_setattr": (314, 274),
    "sched_setaffinity": (203, 122),
    "setpgid": (109, 154),  # a task's processes stay in one group, which the runner ends as a whole
    "setsid": (112, 157),
    "shmget": (29, 194),
    "semget": (64, 190),
    "msgget": (68, 186),
    "mq_open": (240, 180),
}
ADMINISTRATION = {
    "unshare": (272, 97),
    "setns": (308, 268),
    "mount": (165, 40),
    "umount2": (166, 39),
    "pivot_root": (155, 41),
    "chroot": (161, 51),
    "open_tree": (428, 428),
    "move_mount": (429, 429),
    "fsopen": (430, 430),
    "fsconfig": (431, 431),
    "fsmount": (432, 432),
    "fspick": (433, 433),
    "mount_setattr": (442, 442),
    "add_key": (248, 217),
    "request_key": (249, 218),
    "keyctl": (250, 219),
    "bpf": (321, 280),
    "perf_event_open": (298, 241),
    "userfaultfd": (323, 282),
    "init_module": (175, 105),
    "finit_module": (313, 273),
    "delete_module": (176, 106),
    "kexec_load": (246, 104),
    "kexec_file_load": (320, 294),
    "reboot": (169, 142),
    "swapon": (167, 224),
    "swapoff": (168, 225),
    "acct": (163, 89),
    "quotactl": (179, 60),
    "quotactl_fd": (443, 443),
    "syslog": (103, 116),
    "sethostname": (170, 161),
    "setdomainname": (171, 162),
    "settimeofday": (164, 170),
    "clock_settime": (227, 112),
    "adjtimex": (159, 171),
    "clock_adjtime": (305, 266),
    "iopl": (172, None),
    "ioperm": (173, None),
    "modify_ldt": (154, None),
    "personality": (135, 92),
    "vhangup": (153, 58),
    "lookup_dcookie": (212, 18),
    "fanotify_init": (300, 262),
    "name_to_handle_at": (303, 264),
    "open_by_handle_at": (304, 265),
}
ATTRIBUTES_OF_FILES = {
    "chmod": (90, None),
    "fchmod": (91, 52),
    "fchmodat": (268, 53),
    "fchmodat2": (452, 452),
    "chown": (92, None),
    "fchown": (93, 55),
    "lchown": (94, None),
    "fchownat": (260, 54),
    "setxattr": (188, 5),
    "lsetxattr": (189, 6),
    "fsetxattr": (190, 7),
    "removexattr": (197, 14),
    "lremovexattr": (198, 15),
    "fremovexattr": (199, 16),
    "utime": (132, None),
    "utimes": (235, None),
    "futimesat": (261, None),
    "utimensat": (280, 88),
    "mknod": (133, None),
    "mknodat": (259, 33),
}
REFUSED = NETWORK | OTHER_PROCESSES | ADMINISTRATION | ATTRIBUTES_OF_FILES
PROGRAMS = {"fork": (57, None), "vfork": (58, None), "execve": (59, 221), "execveat": (322, 281)}
CLONE, CLONE3, KILL, TGKILL, PRLIMIT = (56, 220), (435, 435), (62, 129), (234, 131), (302, 261)
NEWEST = 462  # later calls are unknown to this list
# Machine: column above, audit architecture, number of seccomp(2).
MACHINES = {"x86_64": (0, 0xC000003E, 317), "aarch64": (1, 0xC00000B7, 277)}

_LOAD_WORD, _RETURN = 0x20, 0x06
_JUMP_IF_EQUAL, _JUMP_IF_LATER, _JUMP_IF_ANY_BIT = 0x15, 0x25, 0x45
_NUMBER_AT, _ARCHITECTURE_AT, _FIRST_ARGUMENT_AT = 0, 4, 16
_ALLOW, _KILL_PROCESS, _FAIL = 0x7FFF0000, 0x80000000, 0x00050000
_SET_MODE_FILTER, _ALL_THREADS = 1, 1
_PR_GET_SECCOMP, _PR_SET_NO_NEW_PRIVS = 21, 38
_FILTERED = 2
"""What `_PR_GET_SECCOMP` answers under any filter."""
_CLONE_THREAD = 0x00010000
_CLONE_NAMESPACES = 0x7E020000

Instruction = tuple[int, int, int, int]
"""Code, jump if true, jump if false, value."""


class _Program(ctypes.Structure):
    _fields_ = (("length", ctypes.c_uint16), ("instructions", ctypes.c_char_p))


def install_filter(rights: Rights) -> None:
    """Filters the system calls of every thread of this process for ever.

    Raises:
        OSError: The machine is unknown, or the kernel has no seccomp filters.
    """
    if platform.machine() not in MACHINES:
        raise OSError(errno.ENOSYS, f"no list of system calls for {platform.machine()}")
    column, architecture, seccomp = MACHINES[platform.machine()]
    body = _allowed(column) if rights is Rights.COMPUTE else _refused(column, rights, os.getpid())
    instructions = [
        (_LOAD_WORD, 0, 0, _ARCHITECTURE_AT),
        (_JUMP_IF_EQUAL, 1, 0, architecture),
        (_RETURN, 0, 0, _KILL_PROCESS),  # a call by another architecture's table
        (_LOAD_WORD, 0, 0, _NUMBER_AT),
        *body,
    ]
    packed = b"".join(
        code.to_bytes(2, "little") + bytes((yes, no)) + value.to_bytes(4, "little")
        for code, yes, no, value in instructions
    )
    program = _Program(len(instructions), packed)
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.prctl(_PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0):
        raise OSError(ctypes.get_errno(), f"no_new_privs: {os.strerror(ctypes.get_errno())}")
    if libc.syscall(seccomp, _SET_MODE_FILTER, _ALL_THREADS, ctypes.byref(program)):
        raise OSError(ctypes.get_errno(), f"seccomp: {os.strerror(ctypes.get_errno())}")


def is_filtered() -> bool:
    """Whether this process is a confined one; the filter that a container has by itself lets it open a socket."""
    if ctypes.CDLL(None).prctl(_PR_GET_SECCOMP, 0, 0, 0, 0) != _FILTERED:
        return False
    try:
        socket.socket(socket.AF_UNIX).close()
    except PermissionError:
        return True
    return False


def _allowed(column: int) -> list[Instruction]:
    passes = (_call(numbers[column], _answer(_ALLOW)) for numbers in ALLOWED.values())
    return [one for rule in passes for one in rule] + [_answer(_FAIL | errno.EPERM)]


def _refused(column: int, rights: Rights, own: int) -> list[Instruction]:
    refuse, unknown, allow = _answer(_FAIL | errno.EPERM), _answer(_FAIL | errno.ENOSYS), _answer(_ALLOW)
    refused = REFUSED if rights is Rights.PROGRAMS else REFUSED | PROGRAMS
    numbers = [number for entry in refused.values() if (number := entry[column]) is not None]
    argument = (_LOAD_WORD, 0, 0, _FIRST_ARGUMENT_AT)
    if rights is Rights.PROGRAMS:
        clone = (argument, (_JUMP_IF_ANY_BIT, 0, 1, _CLONE_NAMESPACES), refuse, allow)
    else:
        clone = (argument, (_JUMP_IF_ANY_BIT, 1, 0, _CLONE_THREAD), refuse, allow)
    only = {KILL[column]: 0, TGKILL[column]: own, PRLIMIT[column]: 0}  # the own group, process, process
    return [
        (_JUMP_IF_LATER, 0, 1, NEWEST),
        unknown,
        *(one for number in numbers for one in _call(number, refuse)),
        *_call(CLONE3[column], unknown),  # its flags are out of a filter's sight; callers then use clone
        *_call(CLONE[column], *clone),
        *(
            one
            for number, value in only.items()
            for one in _call(number, argument, (_JUMP_IF_EQUAL, 1, 0, value), refuse, allow)
        ),
        allow,
    ]


def _call(number: int, *then: Instruction) -> Sequence[Instruction]:
    """Instructions for one system call; the last one returns."""
    return ((_JUMP_IF_EQUAL, 0, len(then), number), *then)


def _answer(value: int) -> Instruction:
    return (_RETURN, 0, 0, value)
