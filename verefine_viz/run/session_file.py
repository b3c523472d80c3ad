"""Session files: TOML in and out, presets, and errors that name the field and who wrote it."""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import tomli_w
from msgspec.inspect import LiteralType, StructType, Type, UnionType, VarTupleType, type_info

from verefine_viz.core.errors import ContentError, InputError, SettingsError, quoted, unknown
from verefine_viz.core.files import read_file
from verefine_viz.core.presets import preset_fields
from verefine_viz.core.setting_types import fields_of
from verefine_viz.core.settings import SURROUNDINGS, Session
from verefine_viz.core.writing import atomic, expand_home
from verefine_viz.run.former_settings import without_former

Raw = Mapping[str, Any]
Layer = tuple[str, Raw]
"""Where settings were written ("s.toml", "command line"), and what was written there, nested as in a session file."""
TYPED = "command line"
"""Where settings come from that are in no file, in messages."""
_ESTIMATORS = ("ppf", "pcs")
"""Sections that only an estimator of their name reads."""
_BEFORE_IT = ("scene", "data", "hypotheses", *_ESTIMATORS, "breakpoints", "recording")
"""Sections of what comes before a run, and of what happens beside it."""
AT_ITS_START = tuple(
    name for name, field in fields_of(Session).items() if isinstance(field.type, StructType) and name not in _BEFORE_IT
)
"""Sections that can change when a run begins again on the same frame: all others."""
WITH_ITS_DATA = ("data", "hypotheses")
"""Sections that can change when the frame is read again, which gives other images or initial poses."""
DURING_A_RUN = tuple(name for name in AT_ITS_START if name not in ("dependency", "grasp"))
"""Sections that can change from one iteration to the next; of physics, what is simulated but not in which world."""
FILES = (
    ("dependency", "order_file"),
    ("depth_net", "weights"),
    ("densefusion", "weights"),
    ("densefusion", "refiner_weights"),
    ("physics", "mesh"),
    ("physics", "collider_folder"),
    ("grasp", "folder"),
    ("scene", "layout"),
    ("scene", "labels"),
    ("scene", "models"),
)
"""Sections and fields that name one file; of the scene and the hypotheses it depends on others what they name."""
_READ_BY = {
    ("scene", "dataset"): ("source", ("bop", "folder", "layout", "labels")),
    ("scene", "layout"): ("source", ("layout",)),
    ("scene", "labels"): ("source", ("labels",)),
    ("scene", "models"): ("source", ("labels",)),
    ("scene", "demo"): ("source", ("demo",)),
    ("scene", "turned"): ("source", ("demo", "layout")),
    ("hypotheses", "files"): ("source", ("results",)),
    ("physics", "mesh"): ("support", ("mesh",)),
}
"""Fields that are read with some values of another field of their section only: that field, and the values."""
_OPEN_QUOTE = ("character '\\n'", """Expected "'" (""")
"""The parser's message on a text that does not end in its line, or at all."""
LARGEST_BYTES = 10_000_000
"""No session file is larger; another file that was named by mistake may fill the memory."""
DEEPEST = 20
"""Levels of lists and tables. Those of settings are six; what checks and writes them calls itself for each."""
CAPTURE_HEAD = "# Kept frames. This file is written anew with every frame: copy it before you change it.\n"
"""How the session file of a folder of kept frames begins; all of it until the first frame is nearly written."""
SCENE_ID = 1


def load_session(path: Path | None, overrides: Raw | None = None, origin: str = TYPED) -> Session:
    """The session of a file, with ``overrides`` (nested like the file) on top; without a file, of the defaults.

    Relative paths in the file are taken from its folder; paths in ``overrides`` from the working directory.

    Args:
        path: the file.
        overrides: settings on top.
        origin: where these come from, in messages.

    Raises:
        InputError: the file cannot be read, or is that of a folder of kept frames without a finished frame.
        SettingsError: it is not TOML or empty, a field is unknown or out of range, or data are named that the chosen
            source does not read.
    """
    typed = (origin, _with_absolute_paths(overrides or {}, Path.cwd()))
    if path is None:
        return _merge_layers([typed])
    raw = _read(path)
    if not raw and not overrides:
        raise SettingsError(f'session file {path} is empty, expected at least a [scene], such as demo = "mug"')
    return _merge_layers([(str(path), _with_absolute_paths(raw, path.parent)), typed])


def resolve(raw: Raw, origin: str = "session") -> Session:
    """The session of explicit fields ``raw``: the preset fills in what they leave open.

    Raises:
        SettingsError: a field is unknown or out of range, or data are named that the chosen source does not read;
            the text names the field and what was expected.
    """
    return _merge_layers([(origin, raw)])


def changed(
    session: Session, settings: Mapping[str, Mapping[str, Any]], allowed: tuple[str, ...] = DURING_A_RUN
) -> Session:
    """``session`` with some fields of the ``allowed`` sections replaced, by default what can change during a run.

    Raises:
        SettingsError: another section, an unknown field, or a value out of range.
    """
    for section in settings:
        if section not in allowed:
            when = "during a run" if allowed == DURING_A_RUN else "at the start of a run"
            raise SettingsError(unknown(f"section that can change {when}", section, allowed))
    fixed = [name for name in settings.get("physics", ()) if name in SURROUNDINGS and allowed == DURING_A_RUN]
    if fixed:
        raise SettingsError(
            f"physics.{fixed[0]} makes another world and cannot change during a run; restart the run with it"
        )
    return _converted(_merged(msgspec.to_builtins(session), settings), [("changed settings", settings)])


def session_toml(session: Session) -> str:
    """The session as TOML with every field explicit; loading it gives the same session."""
    return tomli_w.dumps(_without_none(msgspec.to_builtins(session)))


def save_session(session: Session, path: Path, head: str = "") -> None:
    """Writes :func:`session_toml` to ``path``, whole or not at all, below the comments of ``head``.

    Raises:
        InputError: the file cannot be written.
    """
    with atomic(path) as part:
        part.write_text(head + session_toml(session), encoding="utf-8")


def parsed_toml(text: str) -> dict[str, Any]:
    """The content of a text in TOML.

    Raises:
        ValueError: it is not TOML, or its numbers are too long or its lists too deep.
    """
    too_deep = f"it has lists or tables of more than {DEEPEST} levels"
    try:
        raw = tomllib.loads(text)
    except RecursionError:
        raise ContentError(too_deep) from None
    if _is_deeper(raw, DEEPEST):
        raise ContentError(too_deep)
    return raw


def _merge_layers(layers: Sequence[Layer]) -> Session:
    """The session that some layers of explicit fields add up to, the later over the earlier."""
    layers = [(origin, without_former(fields)) for origin, fields in layers]
    raw: dict[str, Any] = {}
    for _, fields in layers:
        raw = _merged(raw, fields)
    scene = raw.get("scene")
    if isinstance(scene, Mapping) and isinstance(name := scene.get("frames"), str) and name:  # A list by its name.
        raw["scene"] = {**scene, "frames": [name]}
    method = raw.get("method")
    refiner = method.get("refiner") if isinstance(method, Mapping) else None
    preset = preset_fields(str(raw.get("preset", Session().preset)), str(refiner) if refiner else None)
    session = _converted(_merged(preset, raw), layers)
    _check_sources(session, layers)
    for k, change in enumerate(session.changes):
        try:
            changed(session, change.settings)
        except SettingsError as error:
            origin = next(origin for origin, fields in reversed(layers) if "changes" in fields)
            raise SettingsError(f"{origin}: changes.{k}: {error}") from None
    return session


def _merged(base: Raw, top: Raw) -> dict[str, Any]:
    """``top`` over ``base``, section by section."""
    out: dict[str, Any] = dict(base)
    for key, value in top.items():
        below = out.get(key)
        out[key] = _merged(below, value) if isinstance(below, Mapping) and isinstance(value, Mapping) else value
    return out


def _with_absolute_paths(raw: Raw, folder: Path) -> dict[str, Any]:
    """Every path of a session made absolute: of data set, masks, results files, order file, weights and mesh."""
    out = _merged({}, raw)
    scene, hypotheses = out.get("scene"), out.get("hypotheses")
    if isinstance(scene, Mapping):
        scene = dict(scene)
        if isinstance(scene.get("dataset"), str) and scene["dataset"]:
            scene["dataset"] = _absolute(scene["dataset"], folder)
        if isinstance(scene.get("masks"), str) and scene["masks"] not in ("mask", "mask_visib"):
            scene["masks"] = _absolute(scene["masks"], folder)
        out["scene"] = scene
    if isinstance(hypotheses, Mapping) and isinstance(hypotheses.get("files"), list | tuple):
        files = [_absolute(f, folder) if isinstance(f, str) else f for f in hypotheses["files"]]
        out["hypotheses"] = {**hypotheses, "files": files}
    for section, field in FILES:
        fields = out.get(section)
        if isinstance(fields, Mapping) and isinstance(fields.get(field), str) and fields[field]:
            out[section] = {**fields, field: _absolute(fields[field], folder)}
    return out


def _absolute(path: str, folder: Path) -> str:
    # What no path can be is refused with the field that holds it; a loop of links where the file is opened.
    whole = path if "\0" in path else os.path.realpath(folder / expand_home(path))
    if whole != whole.encode("utf-8", "replace").decode():
        raise InputError(f"{whole} is no UTF-8, in which session files are written; rename it")
    return whole


def _without_none(value: Any) -> Any:
    """TOML has no null: a field that is None is left out, which is its default."""
    if isinstance(value, dict):
        return {k: _without_none(v) for k, v in value.items() if v is not None}
    return value


def _read(path: Path) -> dict[str, Any]:
    if os.path.isdir(path):  # noqa: PTH112 (without an error where a name is too long, or holds a NUL)
        inside = path / "session.toml"
        hint = f"; did you mean {inside}?" if inside.is_file() else ""
        raise InputError(f"session file {path} cannot be read: it is a folder, expected a .toml file{hint}")
    content = read_file(path, "session file", LARGEST_BYTES)
    try:
        # Some editors begin a text with a byte order mark, which TOML does not know; some end lines as Windows does.
        text = content.decode("utf-8-sig").replace("\r\n", "\n")
        raw = parsed_toml(text)
    except UnicodeDecodeError:
        raise InputError(f"session file {path} cannot be read: it is no text, expected a .toml file") from None
    except ValueError as error:
        is_open = any(message in str(error) for message in _OPEN_QUOTE)
        hint = "; a quote is opened there or before and not closed" if is_open else ""
        raise SettingsError(f"session file {path} is not TOML: {error}{hint}") from None
    _check_holds_a_frame(path, text, raw)
    return raw


def _is_deeper(value: Any, levels: int) -> bool:
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return levels < 0 or any(_is_deeper(part, levels - 1) for part in inner)


def scene_folder(folder: Path) -> Path:
    """Where the frames of a folder are."""
    return folder / "test" / f"{SCENE_ID:06d}"


def _check_holds_a_frame(path: Path, text: str, raw: Raw) -> None:
    """Raises InputError where the session file is that of a folder of kept frames without a finished frame."""
    if not text.startswith(CAPTURE_HEAD):
        return
    scene = scene_folder(path.parent)
    # The camera is the last file of a frame. A copy of the session elsewhere has no scene beside it.
    if not raw or (scene.is_dir() and not (scene / "scene_camera.json").is_file()):
        raise InputError(
            f"{path.parent} holds no whole frame yet: the first one is still being written, or its program was "
            "stopped in the middle; keep a frame there again, which replaces it, and then open this session"
        )


def _check_sources(session: Session, layers: Sequence[Layer]) -> None:
    """Checks that the chosen sources read what was written down; of ``layers`` the later wins.

    A source that was written together with a field, or over it, was chosen on purpose; one that was not written, or
    only below the field, was forgotten.

    Raises:
        SettingsError: a field is set that its section's source does not read, and the source was not chosen with it;
            or two sections do not go together.
    """
    for (section, field), (chooser, readers) in _READ_BY.items():
        settings, at = getattr(session, section), _last(layers, section, field)
        chosen = getattr(settings, chooser)
        if getattr(settings, field) and chosen not in readers and _last(layers, section, chooser) < at:
            raise SettingsError(
                f'{layers[at][0]}: {section}.{field} is set, but {section}.{chooser} is "{chosen}" and does not read '
                f'it; set {section}.{chooser} = "{readers[0]}", or leave {section}.{field} out'
            )
    source, scene = session.hypotheses.source, session.scene.source
    is_trace = session.method.name == "trace"
    conflicts = (
        (is_trace and source != "recorded", f'method "trace" needs hypotheses.source = "recorded", is "{source}"'),
        (is_trace and session.method.track, 'method "trace" takes no other initial poses; leave method.track out'),
        (
            source == "recorded" and scene != "folder",
            f'hypotheses.source "recorded" needs scene.source = "folder", is "{scene}"',
        ),
    )
    for holds, fault in conflicts:
        if holds:
            raise SettingsError(f"{layers[-1][0]}: {fault}")
    read = {source, *(kind for *_, kind in session.hypotheses.estimate)}
    for name in _ESTIMATORS:
        at = _last(layers, name)
        if at >= 0 > _last(layers, "hypotheses", "source") and name not in read:
            raise SettingsError(
                f'{layers[at][0]}: [{name}] is set, but hypotheses.source is "{source}" and does not read it; '
                f'set hypotheses.source = "{name}", or write "{source}" there if that is meant'
            )


def _last(layers: Sequence[Layer], *steps: str) -> int:
    """Number of the last layer in which a field was written, from 0; -1 where none has it."""
    return max((k for k, (_, raw) in enumerate(layers) if _has(raw, steps)), default=-1)


def _has(raw: Any, steps: Sequence[str]) -> bool:
    """Whether a field was written; of entries of lists, whether the list was."""
    if not steps or not isinstance(raw, Mapping):
        return True
    return steps[0] in raw and _has(raw[steps[0]], steps[1:])


def _converted(raw: Raw, layers: Sequence[Layer]) -> Session:
    """The session of all fields of some layers.

    Raises:
        SettingsError: a field is unknown or out of range; the text names it and the last layer that has it.
    """
    try:
        # Not strict: 5.0 and "5" are whole numbers as well.
        session = msgspec.convert(raw, Session, strict=False)
        msgspec.json.encode(session)
    except UnicodeEncodeError as error:
        wrong = quoted(error.object)
        raise SettingsError(f"{layers[-1][0]}: {wrong} is no UTF-8, in which session files are written") from None
    except msgspec.ValidationError as error:
        steps, mistake = _mistake(raw, str(error))
        raise SettingsError(f"{layers[_last(layers, *steps)][0]}: {mistake}") from None
    return session


def _mistake(raw: Raw, message: str) -> tuple[Sequence[str], str]:
    """The field that a message of msgspec is about, by the steps to it, as ["scene", "objects", "0"]; and the message
    with that place, and with the names or choices that exist or the value.
    """
    known = sorted(Session.__struct_fields__)
    strange = next((name for name in raw if name not in known), None)
    if strange is not None:  # It may hold anything, also what looks like a place.
        return [strange], unknown("field", strange, known)
    what, _, place = message.rpartition(" - at `$")
    if not what:
        return [], message
    steps = re.findall(r"\w+", place)
    field, colon, check = what.partition(": ")
    if colon and field.isidentifier():  # A section's own check.
        steps, what = [*steps, field], check
    value, kind = _found(raw, steps)
    where = ".".join(steps)
    if isinstance(kind, StructType) and what.startswith("Object contains unknown field"):
        names = sorted(field.name for field in kind.fields)
        name = next(name for name in value if name not in names)
        return [*steps, name], f"{where}: {unknown('field', name, names)}"
    ways = kind.types if isinstance(kind, UnionType) else (kind,)
    choices = [choice for way in ways if isinstance(way, LiteralType) for choice in way.values]
    if choices and what.startswith("Invalid enum value"):
        return steps, f"{where}: {unknown('choice', value, choices)}"
    what = re.sub(r", got `\w+`$", "", what.replace("Expected", "expected").replace("Object", "object"))
    return steps, f"{where}: {what}{f', is {quoted(value)}' if what.startswith('expected') else ''}"


def _found(value: Any, steps: Sequence[str]) -> tuple[Any, Type]:
    """What settings hold at a place of a session, and the type of what belongs there."""
    kind = type_info(Session)
    for step in steps:
        value = value[int(step)] if isinstance(value, list | tuple) else value[step]
        match kind:
            case StructType():
                kind = next(field.type for field in kind.fields if field.name == step)
            case VarTupleType():
                kind = kind.item_type
    return value, kind
