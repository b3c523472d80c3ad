"""The documents agree with the code: files, links, numbers, paper sections and presets that they name exist."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import get_args

import msgspec
import pytest

from verefine_viz import cli
from verefine_viz.core.errors import SettingsError
from verefine_viz.core.presets import preset_fields
from verefine_viz.core.setting_types import descriptions
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.methods.known_methods import ALL_METHOD_NAMES
from verefine_viz.page.protocol import AnyVerb, AnyWant, Verb, Wanted
from verefine_viz.page.verbs import HANDLERS
from verefine_viz.page.wants import ANSWERS
from verefine_viz.run.session_file import resolve

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "verefine_viz"
METHODS, PAPER = ROOT / "docs" / "methods.md", ROOT / "docs" / "paper.md"
DOCUMENTS = [ROOT / "CONTRIBUTING.md", ROOT / "SECURITY.md", *sorted((ROOT / "docs").rglob("*.md"))]
SOURCES = [
    path
    for folder in ("verefine_viz", "tests", "bench")
    for path in sorted((ROOT / folder).rglob("*"))
    if path.suffix in (".py", ".comp", ".glsl") and path != Path(__file__)
]
NUMBER = r"\d+(?:\.\d+)*"


def text(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def name_of(path: Path) -> str:
    return str(path.relative_to(ROOT))


def anchors(path: Path) -> set[str]:
    """Of the headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.+)$", text(path), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


def paths_in(content: str) -> set[str]:
    """What stands in backticks and begins with a folder of the repository or of the package."""
    folders = {p.name for where in (ROOT, PACKAGE) for p in where.iterdir() if p.is_dir()}
    return {path for path in re.findall(r"`([\w./*-]+/[\w./*-]*)`", content) if path.split("/")[0] in folders}


def test_every_file_that_is_named_exists() -> None:
    for document in DOCUMENTS:
        named = sorted(paths_in(text(document)))
        missing = [p for p in named if not any(any(where.glob(p.rstrip("/"))) for where in (ROOT, PACKAGE))]
        assert missing == [], name_of(document)


def test_the_documents_name_files() -> None:
    assert len(paths_in(text(ROOT / "docs" / "architecture.md"))) > 50
    assert len(paths_in(text(ROOT / "CONTRIBUTING.md"))) > 30


def test_every_link_leads_somewhere() -> None:
    for document in (ROOT / "README.md", *DOCUMENTS):
        for link in re.findall(r"\]\(([^)\s]+)\)", text(document)):
            if "://" in link:
                continue
            path, _, anchor = link.partition("#")
            target = document.parent / path if path else document
            assert target.exists(), (name_of(document), link)
            assert not anchor or anchor in anchors(target), (name_of(document), link)


def test_every_command_is_one_the_program_takes(capsys: pytest.CaptureFixture[str]) -> None:
    commands = [
        command.split(" #")[0].split()
        for path in (ROOT / "README.md", *DOCUMENTS)
        for command in re.findall(r"(?:`|^)(?:\.venv/bin/)?verefine-viz ([^`\n…|[]+)(?:`|$)", text(path), re.MULTILINE)
    ]
    assert len(commands) > 50
    refused = []
    for words in commands:
        try:
            cli.parse(words)
        except (SettingsError, SystemExit):
            refused.append((words, capsys.readouterr().err))
    # A command may be named without all that it needs, and NAME stands for a choice.
    assert [one for one in refused if "Missing from" not in one[1] and "NAME" not in one[0]] == []


def test_every_measurement_has_its_program_with_its_options() -> None:
    commands = re.findall(r"`python -m (bench[\w.]*)([^`]*)`", "".join(text(path) for path in DOCUMENTS))
    assert len(commands) > 10
    for module, words in commands:
        parts = module.split(".")
        program = ROOT.joinpath(*parts, "__main__.py") if len(parts) == 1 else ROOT.joinpath(*parts).with_suffix(".py")
        assert program.is_file(), module
        assert all(option in text(program) for option in re.findall(r"--[\w-]+", words)), (module, words)


def test_every_number_that_the_code_refers_to_is_a_heading() -> None:
    headings = set(re.findall(rf"^#+ ({NUMBER}) ", text(METHODS), re.MULTILINE))
    reference = re.compile(rf"docs/methods\.md(?:[\s#]+({NUMBER}(?:(?:,| and)[\s#]+{NUMBER})*))?")
    referred = {
        (name_of(source), number)
        for source in SOURCES
        for found in reference.finditer(text(source))
        for number in re.findall(NUMBER, found[1] or "") or [""]
    }
    assert len(referred) > 50
    assert {(source, number) for source, number in referred if number not in headings} == set()


def test_every_method_is_in_the_help_and_in_the_document_of_methods() -> None:
    helped = set(re.findall(r"\w+", descriptions(MethodSettings)["name"]))
    for name in ALL_METHOD_NAMES:
        assert name in helped, name
        assert f"`{name}`" in text(METHODS), name


def test_every_verb_and_want_of_the_page_is_decoded_answered_and_described() -> None:
    described = text(ROOT / "docs" / "page.md")
    for base, decoded, answered in ((Verb, AnyVerb, HANDLERS), (Wanted, AnyWant, ANSWERS)):
        assert set(base.__subclasses__()) == set(get_args(decoded)) == answered.keys()
        for kind in answered:
            assert f"`{kind.__struct_config__.tag}`" in described, kind


def test_the_architecture_is_short_and_its_layers_are_those_that_are_checked() -> None:
    page = text(ROOT / "docs" / "architecture.md")
    assert len(page.splitlines()) <= 150
    contract = tomllib.loads(text(ROOT / "pyproject.toml"))["tool"]["importlinter"]["contracts"][0]
    drawn = re.findall(r"^  (\w+(?: │ \w+)*)  ", page, re.MULTILINE)
    assert [row.split(" │ ") for row in drawn] == [
        [name.removeprefix("verefine_viz.") for name in layer.split(" | ")] for layer in contract["layers"]
    ]
    packages = {path.parent.name for path in PACKAGE.glob("*/__init__.py")}
    assert packages | {"cli"} == {name for row in drawn for name in row.split(" │ ")}


def test_every_paper_section_that_is_named_is_one_of_the_paper() -> None:
    sections = set(re.findall(r"^\| ([IV]+(?:-[A-D])?)\b", text(PAPER), re.MULTILINE))
    assert {"III-A", "IV-B", "V-D", "VI"} <= sections
    named = {
        (name_of(path), section)
        for path in (*SOURCES, *DOCUMENTS, ROOT / "README.md")
        for section in re.findall(r"\bSec\. ([IV]+(?:-[A-Z])?)\b", text(path))
    }
    assert len(named) > 15
    assert {(path, section) for path, section in named if section not in sections} == set()


def test_the_table_of_presets_is_what_the_code_has() -> None:
    """A value, and in brackets where the paper says so; a dash where the preset leaves what is recommended."""
    cell = r"([^|(]+?)(?: \([^|]*\))?"
    row = re.compile(rf"^\| `(\w+)\.(\w+)` \| {cell} \| {cell} \| {cell} \|.*\|$", re.MULTILINE)
    rows = {(section, field): values for section, field, *values in row.findall(text(METHODS))}
    sets = dict[str, set[tuple[str, str]]]()
    for name in ("paper", "published"):
        sets[name] = {(section, field) for section, of in preset_fields(name).items() for field in of}
    assert rows.keys() == sets["paper"] | sets["published"]
    sessions = {name: resolve({"preset": name}) for name in ("paper", "published", "recommended")}
    for (section, field), written in rows.items():
        values = [getattr(getattr(session, section), field) for session in sessions.values()]
        shown = [f"{value:g}" if type(value) is float else str(value) for value in values]
        expected = [
            value if (section, field) in sets.get(name, rows) else "–"
            for name, value in zip(sessions, shown, strict=True)
        ]
        assert written == expected, (section, field)


def test_the_citation_is_of_the_paper() -> None:
    citation = msgspec.yaml.decode(text(ROOT / "CITATION.cff"))
    assert citation["title"] == "verefine_viz"
    paper = citation["preferred-citation"]
    assert [author["family-names"] for author in paper["authors"]] == ["Bauer", "Patten", "Vincze"]
    assert {"journal", "year", "volume", "doi"} <= paper.keys()


def test_settings_that_methods_and_paper_name_exist() -> None:
    fields = {
        f"{s}.{f}" for s, values in msgspec.to_builtins(Session()).items() if isinstance(values, dict) for f in values
    }
    sections = {name.split(".")[0] for name in fields}
    named = re.findall(r"`(\w+\.\w+)(?: = [^`]*)?`", text(METHODS) + text(PAPER))
    named = [name for name in named if name.split(".")[0] in sections]
    assert len(named) > 50
    assert [name for name in named if name not in fields] == []
