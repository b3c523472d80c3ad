"""What goes wrong inside of a refiner, verifier, estimator or simulator of a user's program."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from traceback import extract_tb

from verefine_viz.core.errors import PartError, VerefineError

_READ_ONLY = re.compile(r"read-?only|not writeable", re.IGNORECASE)
"""What numpy, and libraries as Open3D, say of an array that they want to write into."""
_COPY = "; the arrays that it is given are read-only, as all calls share them: hand on a copy, np.array(x)"
_PACKAGE = str(Path(__file__).resolve().parents[1])


@contextmanager
def own_part(part: str) -> Iterator[None]:
    """Name the part in what it raises, and where in the user's file it was raised.

    Args:
        part: kind and name, as "simulator drop".

    Raises:
        PartError: it raised something; the cause is kept, with its traceback.
    """
    try:
        yield
    except VerefineError:
        raise  # It is cancelled, or says in one line what is wrong.
    except Exception as error:
        frames = [frame for frame in extract_tb(error.__traceback__) if not frame.filename.startswith(_PACKAGE)]
        own = [frame for frame in frames if frame.filename == frames[0].filename]
        where = f" ({Path(own[-1].filename).name}, line {own[-1].lineno})" if own else ""
        fix = _COPY if isinstance(error, ValueError) and _READ_ONLY.search(str(error)) else ""
        raise PartError(f"{part} raised {type(error).__name__}: {error}{where}{fix}") from error
