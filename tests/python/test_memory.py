"""The default bound on the memory of pairwise matrices."""

import subprocess
import sys

import psutil
import pytest

from cgroup._runtime import memory

GIB = 1 << 30
PLENTY = 400 << 20


class System:
    """Made-up folders in the place of /proc and /sys/fs/cgroup."""

    def __init__(self, root, monkeypatch):
        self.proc, self.groups = root / "proc", root / "control groups"
        for folder in (self.proc / "self", self.groups):
            folder.mkdir(parents=True)
        monkeypatch.setattr(memory, "PROC", self.proc)
        monkeypatch.setattr(memory, "CONTROL_GROUPS", self.groups)

    def available(self, kib):
        (self.proc / "meminfo").write_text(f"MemTotal: 1 kB\nMemAvailable: {kib} kB\n")

    def member_of(self, *lines):
        (self.proc / "self/cgroup").write_text("".join(f"{line}\n" for line in lines))

    def limit(self, path, limit, used, reclaimable=0):
        """Limit a group."""
        folder = self.groups / path
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "memory.max").write_text(f"{limit}\n")
        (folder / "memory.current").write_text(f"{used}\n")
        (folder / "memory.stat").write_text(f"anon 5\ninactive_file {reclaimable}\n")


@pytest.fixture
def system(tmp_path, monkeypatch):
    memory._groups.cache_clear()
    yield System(tmp_path, monkeypatch)
    memory._groups.cache_clear()


def test_a_quarter_of_what_is_free(system):
    system.available(4 << 20)
    assert memory.default_max_memory() == memory.max_memory_for(5000) == GIB
    assert memory.max_memory_for(900) == memory.SMALL > 900**2 * 40  # more than any method takes


@pytest.mark.parametrize(
    ("limit", "used", "reclaimable", "bound"),
    [
        pytest.param("max", 0, 0, GIB * 3 // 2, id="at most one and a half GiB"),
        pytest.param(GIB, GIB // 2, 0, GIB // 8, id="a container has its own limit"),
        pytest.param(GIB, GIB // 2, GIB // 4, GIB * 3 // 16, id="files that are kept take no memory"),
        pytest.param(GIB, GIB + 1, 0, 0, id="a full container leaves nothing"),
    ],
)
def test_a_group_limits_the_process(system, limit, used, reclaimable, bound):
    system.available(PLENTY)
    system.limit(".", limit, used, reclaimable)
    assert memory.default_max_memory() == bound


@pytest.mark.parametrize("limited", ["a/b/c", "a/b", "a", "."])
def test_the_groups_around_the_process_s_count_too(system, limited):
    system.available(PLENTY)
    system.member_of("0::/a/b/c")
    for path in ("a/b/c", "a/b", "a", "."):
        system.limit(path, GIB if path == limited else "max", 0)
    system.limit("a/other", 1, 0)
    assert memory.default_max_memory() == GIB // 4


def test_free_memory_is_that_of_psutil():
    assert memory._free_on_machine() == pytest.approx(psutil.virtual_memory().available, rel=0.2)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="needs a limit of address space")
def test_a_limit_of_address_space_leaves_a_share_of_what_is_left_of_it():
    program = """if True:
        import resource
        from cgroup._runtime import memory
        used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + (200 << 20),) * 2)
        print(memory.default_max_memory() >> 20)
    """
    printed = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert 45 <= int(printed.stdout) <= 50
