"""Parts of a session that may be plugged in: whether this program has them; and the weights of what is learned."""

from __future__ import annotations

from collections.abc import Iterator

from verefine_viz.core.errors import SettingsError, unknown
from verefine_viz.core.settings import POSES_GIVEN, Session
from verefine_viz.estimators.registry import ESTIMATORS
from verefine_viz.estimators.registry import WEIGHTS as ESTIMATOR_WEIGHTS
from verefine_viz.methods.known_methods import METHODS, method_of
from verefine_viz.physics.registry import simulator_names
from verefine_viz.refiners.registry import REFINERS, WEIGHTS
from verefine_viz.rendering.registry import verifier_names
from verefine_viz.run.session_file import changed


def check_parts(session: Session, what: str, to_do: str, words: str) -> None:
    """Checks that this program has every refiner, verifier, simulator and estimator with which something was made.

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
    simulators = [("simulator", stage.physics.simulator, simulator_names()) for stage in _stages(session)]
    sources = [("estimator", name, tuple(ESTIMATORS)) for name in estimators_of(session)]
    for kind, name, names in (*refiners, *verifiers, *simulators, *sources):
        if name not in names:
            raise SettingsError(
                f"{what} was made with the {kind} {name!r}, which this program does not have "
                f"(it has {', '.join(names)}); {to_do} it through the program that does, as in docs/guide.md, "
                f'"Your own {kind}": python PROGRAM.py {words}'
            )


def estimators_of(session: Session) -> set[str]:
    """Return the names of the estimators that initial poses come from."""
    h = session.hypotheses
    return ({h.source} - {*POSES_GIVEN}) | {name for *_, name in h.estimate}


def check_names(session: Session) -> None:
    """Check that this program has the method, refiner, verifier, simulator and source of initial poses of a session,
    those too that its method does not use.

    Raises:
        SettingsError: one is not there; lists what is.
    """
    for kind, name, known in (
        ("method", session.method.name, tuple(METHODS)),
        ("refiner", session.method.refiner, tuple(REFINERS)),
        ("verifier", session.score.verifier, verifier_names()),
        ("simulator", session.physics.simulator, simulator_names()),
        ("hypotheses.source", session.hypotheses.source, (*POSES_GIVEN, *ESTIMATORS)),
    ):
        if name not in known:
            raise SettingsError(unknown(kind, name, known))


def weights_of(session: Session) -> dict[str, str]:
    """The hashes of the weights that a run of the session uses, by name: ``depth_net weights``; those that it changes
    to are numbered. Those of its initial poses are named ``densefusion estimator weights``.

    Raises:
        SettingsError: weights are not named.
        InputError: a file of weights cannot be read.
    """
    learned = estimators_of(session) & ESTIMATOR_WEIGHTS.keys()
    estimators = {f"{name} estimator weights": ESTIMATOR_WEIGHTS[name](session) for name in learned}
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
    """Its stages whose method has a refiner to choose."""
    return (stage for stage in _stages(session) if not method_of(stage.method.name).has_tree)
