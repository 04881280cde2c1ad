import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = """
import ctypes, os, signal, socket, subprocess, sys
from morphkit.utils.confine import confine
path, = sys.argv[1:]
libc = ctypes.CDLL(None, use_errno=True)
deeds = {
    "read": lambda: open(path),
    "write": lambda: open(path + "2", "w"),
    "list": lambda: os.listdir("/"),
    "remove": lambda: os.remove(path),
    "rename": lambda: os.rename(path, path + "3"),
    "mode": lambda: os.chmod(path, 0o777),
    "run": lambda: subprocess.run(["true"]),
    "exec": lambda: os.execv("/bin/true", ["true"]),
    "fork": os.fork,
    "signal": lambda: os.kill(os.getppid(), 0),
    "socket": socket.socket,
    "datagram": lambda: socket.socket(type=socket.SOCK_DGRAM),
    "local": lambda: socket.socketpair(),
    "32 bit": lambda: None if libc.syscall(0x40000000 | 41, 2, 1, 0) < 0 else 1 / 0,
    "read by number": lambda: None if libc.syscall(2, path.encode(), 0) < 0 else 1 / 0,
}
assert confine()
done = []
for name, deed in deeds.items():
    try:
        if deed() is not None:
            done.append(name)
    except PermissionError:
        pass
print(sum(number * number for number in range(1000)), done, dict(os.environ))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has it")
def test_a_confined_process_can_compute_and_nothing_else(tmp_path: Path) -> None:
    (tmp_path / "here").write_text("as it was")
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, tmp_path / "here"], capture_output=True, text=True, check=False
    )
    assert (done.stdout, done.stderr) == ("332833500 [] {}\n", "")
    assert (tmp_path / "here").read_text() == "as it was"
    assert [path.name for path in tmp_path.iterdir()] == ["here"]
