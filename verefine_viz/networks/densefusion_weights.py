"""Opens DenseFusion's weights: those of the package, ONNX of ``verefine-viz train``, or official ``.pth``.

A ``.pth`` file is converted to ONNX once and cached by the file's hash; from then on torch is not needed for it.
"""

from __future__ import annotations

from pathlib import Path

import platformdirs

from verefine_viz.core.algorithm_settings import DenseFusionSettings
from verefine_viz.core.errors import SettingsError, UnavailableError
from verefine_viz.core.writing import atomic, locked
from verefine_viz.learned.densefusion_steps import POSE_NET, REFINE_NET, DenseFusionPose, DenseFusionSteps
from verefine_viz.learned.onnx_network import PACKAGED, hash_of, read_weights

CACHE_FORMAT = 1
"""Format of the ONNX files in the cache: raise it when they are made in another way."""
SLIM_FILES = {POSE_NET: "densefusion_slim.onnx", REFINE_NET: "densefusion_slim_refine.onnx"}
"""Weights of the package: slim networks, trained on made-up views of the built-in objects."""
_FIELDS = {POSE_NET: "weights", REFINE_NET: "refiner_weights"}


def pose_network(settings: DenseFusionSettings) -> DenseFusionPose:
    """PoseNet with the weights that the settings name, or with those of the package.

    Raises:
        SettingsError: they name weights of PoseRefineNet only.
        InputError: the weights cannot be used.
        UnavailableError: they are a ``.pth`` file, and torch is not installed.
    """
    return DenseFusionPose(onnx_file(_path(settings, POSE_NET), POSE_NET), settings)


def refine_network(settings: DenseFusionSettings) -> DenseFusionSteps:
    """PoseRefineNet with the weights that the settings name, or with those of the package.

    Raises:
        SettingsError, InputError, UnavailableError: as :func:`pose_network`, of the other network.
    """
    return DenseFusionSteps(onnx_file(_path(settings, REFINE_NET), REFINE_NET), settings)


def weights_hash(settings: DenseFusionSettings, with_refiner: bool) -> str:
    """The hash of the weights' file, and of those of the refiner.

    Raises:
        SettingsError, InputError: as :func:`pose_network`.
    """
    names = (POSE_NET, REFINE_NET) if with_refiner else (POSE_NET,)
    return " ".join(hash_of(read_weights(_path(settings, name))) for name in names)


def onnx_file(path: Path, name: str) -> Path:
    """The ONNX file of weights: the file itself, or the conversion of a ``.pth`` file.

    Args:
        path: the weights.
        name: of the network, ``POSE_NET`` or ``REFINE_NET``.

    Raises:
        InputError: the ``.pth`` file cannot be read, or holds no such network.
        UnavailableError: torch is needed to read it, and not installed.
    """
    if path.suffix != ".pth":
        return path
    content = read_weights(path)
    made = _cache() / f"{hash_of(content)}-{name}-{CACHE_FORMAT}.onnx"
    if made.exists():
        return made
    try:
        from verefine_viz.networks.official_weights import onnx_of_pth
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in ("torch", "onnx", "onnxscript"):
            raise
        raise UnavailableError(
            f"weights {path} need {error.name} once, to be made into ONNX: pip install 'verefine-viz[torch]'"
        ) from None
    with locked(made.with_suffix(".lock"), lambda _: None, ""):
        if not made.exists():
            converted = onnx_of_pth(content, path, name)
            with atomic(made) as part:
                part.write_bytes(converted)
    return made


def _path(settings: DenseFusionSettings, name: str) -> Path:
    if getattr(settings, _FIELDS[name]):
        return Path(getattr(settings, _FIELDS[name]))
    (other,) = (field for field in _FIELDS.values() if field != _FIELDS[name])
    if getattr(settings, other):
        raise SettingsError(
            f"densefusion.{_FIELDS[name]} is empty and densefusion.{other} is not; name the weights of the same "
            "training, or neither, for those of the package"
        )
    return PACKAGED / SLIM_FILES[name]


def _cache() -> Path:
    return Path(platformdirs.user_cache_dir("verefine-viz")) / "densefusion"
