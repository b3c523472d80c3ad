"""Libraries of the page: their files are those of the named versions, and the same as what checks the page's types."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import msgspec

from verefine_viz.page.web_files import WEB, libraries

REPOSITORY = Path(__file__).resolve().parents[2]
VENDOR = WEB / "vendor"


class VendoredFile(msgspec.Struct, forbid_unknown_fields=True):
    file: str
    in_package: str
    sha256: str


class Library(msgspec.Struct, forbid_unknown_fields=True):
    name: str
    version: str
    source: str
    licence: str
    files: list[VendoredFile]


VENDORED = msgspec.json.decode((VENDOR / "vendored.json").read_bytes(), type=list[Library])


def test_every_file_is_the_one_that_its_version_has() -> None:
    named = {file.file: file.sha256 for library in VENDORED for file in library.files}
    on_disk = {
        path.name: hashlib.sha256(path.read_bytes()).hexdigest()
        for path in VENDOR.iterdir()
        if path.name != "vendored.json"
    }
    assert on_disk == named


def test_the_import_map_names_every_module_of_them_once() -> None:
    modules = {VENDOR / file.file for library in VENDORED for file in library.files if file.file.endswith(".js")}
    assert sorted(libraries().values()) == sorted(modules)


def test_types_are_those_of_the_same_versions() -> None:
    asked: dict[str, Any] = json.loads((REPOSITORY / "tests" / "web" / "package.json").read_bytes())["devDependencies"]
    locked: dict[str, Any] = json.loads((REPOSITORY / "tests" / "web" / "package-lock.json").read_bytes())["packages"]
    for library in VENDORED:
        assert asked[library.name] == library.version, library.name
        assert locked[f"node_modules/{library.name}"]["version"] == library.version, library.name


def test_the_notice_names_each_with_its_licence() -> None:
    notice = (REPOSITORY / "NOTICE").read_text("utf-8").lower()
    for library in VENDORED:
        assert f"{library.name} {library.version}," in notice
        assert library.source.lower() in notice
        assert any(file.file == f"{library.name}.LICENSE" for file in library.files), library.name
