"""Session files that come with the package and are opened by their names: ``verefine-viz view mug``."""

from __future__ import annotations

from pathlib import Path

from verefine_viz.core.errors import InputError, meant

_PACKAGE = Path(__file__).resolve().parents[1]


def built_in_sessions() -> dict[str, Path]:
    """The file of each, by name: within an installed package, beside it in a checkout."""
    folder = next(place for place in (_PACKAGE / "sessions", _PACKAGE.parent / "sessions") if place.is_dir())
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def named_session(path: Path) -> Path:
    """The built-in session that a bare name means; any other path as it is.

    Raises:
        InputError: a bare name of which there is neither a file nor a session; lists the sessions.
    """
    if path.suffix or path.name != str(path) or path.exists():
        return path
    known = built_in_sessions()
    if path.name not in known:
        names = ", ".join(known)  # All of them: one cannot be asked for elsewhere.
        raise InputError(f"{path} does not exist, and is no session; {meant(path.name, known)}sessions: {names}")
    return known[path.name]
