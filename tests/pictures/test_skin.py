"""A textured model for renderers that want a place in the image for every vertex."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import trimesh

from tests.rendering.witness import model_of
from verefine_viz.core.model import ObjectModel, Texture
from verefine_viz.pictures.skin import skin_of


def textured(seed: int = 0, shared: bool = False) -> ObjectModel:
    """A ball; every face has its own part of the image, or all corners at a vertex the same place in it."""
    rng, model = np.random.default_rng(seed), model_of(trimesh.creation.icosphere(2, 0.05))
    uv = rng.random((len(model.vertices), 2))[model.faces] if shared else rng.random((len(model.faces), 3, 2))
    return replace(model, texture=Texture(rng.integers(0, 255, (300, 200, 3)), uv))


def test_every_corner_is_where_it_was_and_has_its_place_in_the_image() -> None:
    for model in (textured(1), textured(2, shared=True)):
        skin = skin_of(model, 512)
        assert skin is not None
        assert model.texture is not None
        np.testing.assert_array_equal(skin.vertices[skin.faces], model.vertices[model.faces])
        np.testing.assert_array_equal(skin.uv[skin.faces], model.texture.uv)


def test_vertices_are_doubled_along_seams_only() -> None:
    skin = skin_of(model := textured(3, shared=True), 512)
    assert skin is not None
    assert len(skin.vertices) == len(model.vertices)


def test_the_image_is_no_larger_than_asked_for() -> None:
    skin = skin_of(textured(4), 128)
    assert skin is not None
    assert skin.image.shape == (128, 85, 3)


def test_without_texture_there_is_none() -> None:
    assert skin_of(replace(textured(5), texture=None), 128) is None
