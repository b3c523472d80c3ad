"""Small pictures of the models that can be placed in frames to label."""

from __future__ import annotations

from dataclasses import dataclass

from verefine_viz.core.settings import SceneSettings
from verefine_viz.pictures.model_picture import model_picture
from verefine_viz.scenes.unlabelled_frames import Models, unlabelled_frames


@dataclass(frozen=True)
class ModelOfFolder:
    """A model that can be placed."""

    scene: SceneSettings
    obj_id: int


class ModelPainter:
    """Draws models, which it reads itself. Belongs to one thread."""

    def __init__(self) -> None:
        self._models: tuple[SceneSettings, Models] | None = None

    def __call__(self, of: ModelOfFolder) -> bytes:
        """Draw a model, as WebP.

        Raises:
            VerefineError: it cannot be read.
        """
        if self._models is None or self._models[0] != of.scene:
            self._models = of.scene, unlabelled_frames(of.scene).models
        return model_picture(self._models[1].get(of.obj_id))
