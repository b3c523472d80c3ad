"""Run files of format 1: two strings in each answer say why it is wrong, and what of its data is in doubt."""

from __future__ import annotations

import msgspec
from msgspec import Struct, structs

from verefine_viz.core.finding import Finding
from verefine_viz.run.record import DATA_FIRST, RunEnd


class _Answer(Struct):
    cause: str = ""
    evidence: str = ""
    """The cause in a sentence, then the doubts."""


class _End(Struct):
    answers: tuple[_Answer, ...]


_DECODER = msgspec.msgpack.Decoder(_End)


def with_findings(end: RunEnd, body: memoryview) -> RunEnd:
    """The end of a run with the findings and doubts that ``body``, which it was read from, has as strings.

    Raises:
        msgspec.ValidationError: these are no strings.
    """
    answers = []
    for answer, old in zip(end.answers, _DECODER.decode(body).answers, strict=True):
        text, *doubts = (part.strip() for part in old.evidence.split(DATA_FIRST))
        findings = (Finding(old.cause, text),) if old.cause or text else ()
        answers.append(structs.replace(answer, findings=findings, doubts=tuple(d.removesuffix(".") for d in doubts)))
    return structs.replace(end, answers=tuple(answers))


def as_read_from_it(end: RunEnd) -> RunEnd:
    """The end of a run without what a file of format 1 does not hold."""
    answers = []
    for answer in end.answers:
        main = tuple(Finding(one.cause, " ".join(one.text.split())) for one in answer.findings[:1])
        answers.append(structs.replace(answer, findings=main, ar=None, ar_vsd=None, ar_mssd=None, ar_mspd=None))
    return structs.replace(end, answers=tuple(answers))
