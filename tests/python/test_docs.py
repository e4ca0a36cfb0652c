"""Pages of the documentation: links, commands, examples, and a complete reference."""

import importlib
import re
import shlex
from doctest import ELLIPSIS, OutputChecker
from pathlib import Path

import pytest
from public_names import GROUPS

pytest.importorskip("typer", reason="commands are parsed by typer: pip install 'cgroup[scans]'")

from command_lines import parse_command

from cgroup.cli import main

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
IS_SDIST = not (ROOT / ".github").exists()
"""Source distributions have no pictures of Stanford's scans."""

MADE = {"_generated", "gallery", "api"}
"""Folders below docs/ that are made with the site."""
PAGES = [
    *(page for page in sorted(DOCS.rglob("*.md")) if not MADE & set(page.parts)),
    *sorted(ROOT.glob("*.md")),
    ROOT / "benches/peers/README.md",
]


FRAGMENTS = {"benchmark"}
"""Its code reads records, which are made for it in test_extending_docs.py."""

SHOWN = [ROOT / "README.md", *sorted((DOCS / "start").glob("*.md"))]
"""All of their Python that prints, and their commands that a block of text follows, are shown with what they print."""

OTHERS = {"gtsam", "kiss_matcher", "open3d", "rclpy", "small_gicp", "torch"}
"""What pages show cgroup together with, and the tests do without where it isn't installed."""

SHELLS = {"", "sh", "bash", "console"}


def name(page: Path) -> str:
    return str(page.relative_to(ROOT))


def without_code(text: str) -> str:
    return re.sub(r"^(`{3,}|~{3,})[^\n]*\n.*?^\1", "", text, flags=re.DOTALL | re.MULTILINE)


def anchors(page: Path) -> set[str]:
    """Names of the headings, as GitHub and the site make them."""
    headings = re.findall(r"^#+ +(.*)$", without_code(page.read_text(encoding="utf-8")), flags=re.MULTILINE)
    plain = [re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).strip().lower() for heading in headings]
    return {re.sub(r"[^\w\- ]", "", heading).replace(" ", "-") for heading in plain}


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_links_lead_somewhere(page: Path):
    text = without_code(page.read_text(encoding="utf-8"))
    assert not re.search(r"\[[a-z-]+\.md\]\(", text), "a page is named by its title"
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        if re.match(r"https?:|mailto:", link) or "_generated/" in link:
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path) if path else page
        is_left_out = IS_SDIST and re.fullmatch(r"(home.*|interactive)\.png", target.name)
        assert target.exists() or is_left_out, f"{name(page)}: {link} leads nowhere"
        if anchor:
            assert anchor in anchors(target), f"{name(page)}: {link}: {name(target)} has no such heading"


@pytest.mark.parametrize(
    "page", [*SHOWN, *(page for page in PAGES if DOCS in page.parents and page not in SHOWN)], ids=name
)
def test_blocks_run_one_after_another_and_print_what_follows_them(
    page: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    namespace: dict[str, object] = {}
    for language, block, output in blocks_with_output(page):
        if language == "python":
            try:
                exec(compile(block, page.name, "exec"), namespace)
            except ModuleNotFoundError as missing:
                if missing.name not in OTHERS:
                    raise
                pytest.skip(f"the rest of the page needs {missing.name}")
        elif page in SHOWN and output:
            with pytest.raises(SystemExit):
                main(shlex.split(block)[2:])
        else:
            continue
        printed = "".join(capsys.readouterr())
        if output:
            assert OutputChecker().check_output(output, printed, ELLIPSIS), f"{block}prints\n{printed}"
        elif page in SHOWN:
            assert not printed, f"{block}is followed by no text block with\n{printed}"


def blocks_with_output(page: Path) -> list[tuple[str, str, str]]:
    """Blocks of Python and of one command, with the block of text right behind, where ``...`` stands for anything."""
    if page.stem in FRAGMENTS:
        return []
    block, command = r"```(python)\n(.*?)```", r"```(console)\n(\$ cgroup [^\n]*\n)```"
    found = re.findall(
        rf"^(?:{block}|{command})\n(?:\s*^```text\n(.*?)^```)?",
        page.read_text(encoding="utf-8"),
        flags=re.DOTALL | re.MULTILINE,
    )
    return [(kind or other, code or line, output) for kind, code, other, line, output in found]


def commands(page: Path) -> list[str]:
    """Lines that call cgroup, in blocks of shell and in indented ones; lines that go on are joined."""
    text = page.read_text(encoding="utf-8").replace("\\\n", " ")
    blocks = re.findall(r"^```([^\n]*)\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE)
    fenced = [line for kind, block in blocks if kind in SHELLS for line in block.splitlines()]
    indented = re.findall(r"^    (.*)$", without_code(text), flags=re.MULTILINE)
    lines = [
        part.removeprefix("$ ") for line in fenced + indented for part in re.split(r" && | \| | > ", line)
    ]
    return [line for line in lines if line.startswith("cgroup ")]


COMMANDS = {line: name(page) for page in PAGES for line in commands(page)}


@pytest.mark.parametrize("line", COMMANDS, ids=lambda line: f"{COMMANDS[line]}: {line}")
def test_commands_are_understood(line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path))  # of `--install-completion`
    try:
        parse_command(shlex.split(line, comments=True)[1:])
    except SystemExit as done:  # of options that do their work at once
        if done.code:
            raise


@pytest.mark.parametrize("module", GROUPS)
def test_reference_has_just_the_public_names(module: str):
    exported = set(importlib.import_module(module).__all__) - {"__version__"}
    listed = " ".join(GROUPS[module].values()).split()
    assert len(listed) == len(set(listed)), "a name stands twice"
    assert set(listed) == exported, f"{module}: docs/_site/reference.py and __all__ differ"


def test_reference_lacks_no_public_module():
    # What cgroup itself exports stands on its page; the benchmark is shown by its parts, the command line by its help.
    package = ROOT / "python" / "cgroup"
    found = {path.stem for path in package.glob("*.py")} | {
        path.parent.name for path in package.glob("*/*.py")
    }
    public = {f"cgroup.{name}" for name in found if not name.startswith("_")}
    hidden = {"cgroup.explanation", "cgroup.group", "cgroup.methods", "cgroup.cli", "cgroup.benchmark"}
    hidden |= {"cgroup.maps", "cgroup.pose_graph"}  # cgroup.scenes shows their names
    hidden |= {"cgroup.fronts", "cgroup.recognition"}  # cgroup.registration shows theirs
    assert public - set(GROUPS) == hidden
