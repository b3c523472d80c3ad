"""The names of the library, for type checkers; ``__init__.py`` imports each when it is first asked for."""

from verefine_viz.core.errors import VerefineError as VerefineError
from verefine_viz.library.batches import Batch as Batch
from verefine_viz.library.batches import batch as batch
from verefine_viz.library.batches import open_batch as open_batch
from verefine_viz.library.batches import report as report
from verefine_viz.library.frame_to_solve import Frame as Frame
from verefine_viz.library.frame_to_solve import OpenedFrame as OpenedFrame
from verefine_viz.library.frame_to_solve import open_dataset as open_dataset
from verefine_viz.library.frame_to_solve import open_frame as open_frame
from verefine_viz.library.labelling import label as label
from verefine_viz.library.plugins import estimator as estimator
from verefine_viz.library.plugins import refiner as refiner
from verefine_viz.library.plugins import simulator as simulator
from verefine_viz.library.plugins import verifier as verifier
from verefine_viz.library.single_calls import estimate as estimate
from verefine_viz.library.single_calls import evaluate as evaluate
from verefine_viz.library.single_calls import refine as refine
from verefine_viz.library.single_calls import score as score
from verefine_viz.library.single_calls import score_maps as score_maps
from verefine_viz.library.single_calls import settle as settle
from verefine_viz.library.solving import Run as Run
from verefine_viz.library.solving import open_run as open_run
from verefine_viz.library.solving import solve as solve
from verefine_viz.library.solving import step as step
from verefine_viz.page.notebook import show as show
from verefine_viz.page.share import share as share
from verefine_viz.trace import Trace as Trace

__version__: str
