"""Refiners and verifiers of a session: whether this program has them; and the weights of all that is learned in it."""

from __future__ import annotations

from collections.abc import Iterator

from verefine_viz.core.errors import SettingsError
from verefine_viz.core.settings import Session
from verefine_viz.estimators.registry import WEIGHTS as ESTIMATOR_WEIGHTS
from verefine_viz.methods.registry import method_of
from verefine_viz.refiners.registry import REFINERS, WEIGHTS
from verefine_viz.rendering.registry import verifier_names
from verefine_viz.run.session_file import changed


def check_refiners(session: Session, what: str, to_do: str, words: str) -> None:
    """Checks that this program has every refiner and every verifier with which something was made.

    Args:
        session: how it was made.
        what: what was made, as "recording run.rrd".
        to_do: what was to be done with it now, as "verify".
        words: the words that do so, as "replay run.rrd --verify".

    Raises:
        SettingsError: one is not there; the text says through which program to do it.
    """
    refiners = [("refiner", stage.method.refiner, tuple(REFINERS)) for stage in _with_refiner(session)]
    verifiers = [("verifier", stage.score.verifier, verifier_names()) for stage in _stages(session)]
    for kind, name, names in (*refiners, *verifiers):
        if name not in names:
            raise SettingsError(
                f"{what} was made with the {kind} {name!r}, which this program does not have "
                f"(it has {', '.join(names)}); {to_do} it through the program that does, as in docs/guide.md, "
                f'"Your own {kind}": python PROGRAM.py {words}'
            )


def weights_of(session: Session) -> dict[str, str]:
    """The hashes of the weights that a run of the session uses, by name: ``depth_net weights``; those that it changes
    to are numbered. Those of its initial poses are named ``densefusion estimator weights``.

    Raises:
        SettingsError: weights are not named.
        InputError: a file of weights cannot be read.
    """
    h = session.hypotheses
    sources = {h.source, *(name for *_, name in h.estimate)}
    estimators = {
        f"{name} estimator weights": ESTIMATOR_WEIGHTS[name](session) for name in sources & ESTIMATOR_WEIGHTS.keys()
    }
    hashes: dict[str, str] = {}
    for stage in _with_refiner(session):
        if stage.method.refiner in WEIGHTS:
            digest = WEIGHTS[stage.method.refiner](stage)
            if digest not in hashes.values():
                n = len(hashes)
                hashes[f"{stage.method.refiner} weights{f' ({n + 1})' if n else ''}"] = digest
    return estimators | hashes


def _stages(session: Session) -> list[Session]:
    """The session as it is at first and after each change during the run."""
    stages = [session]
    for change in sorted(session.changes, key=lambda change: change.after_iteration):
        stages.append(changed(stages[-1], change.settings))
    return stages


def _with_refiner(session: Session) -> Iterator[Session]:
    """Those of its stages whose method has a refiner to choose."""
    return (stage for stage in _stages(session) if not method_of(stage.method.name).has_tree)
