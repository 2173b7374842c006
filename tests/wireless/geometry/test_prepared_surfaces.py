"""Surfaces of large meshes from disk: equal to those that are computed, and computed again for another mesh."""

import numpy as np
import pytest
import trimesh

from tests.wireless.tracing.rounded import box
from wireless.geometry import prepared_surfaces as module
from wireless.geometry.facets import find_surfaces
from wireless.geometry.patches import find_patches
from wireless.geometry.prepared_surfaces import prepare_surfaces
from wireless.support import cached_array


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(cached_array, "writable_folder", lambda folders: tmp_path)
    monkeypatch.setattr(module, "LARGE", 12)
    return tmp_path


def test_prepare_surfaces_reads_what_it_computed(folder, monkeypatch):
    mesh, material = box((8, 6, 2.7), (4, 3, 1.35)), np.arange(12) // 6
    surfaces = find_surfaces(mesh, material, 1e-6)
    expected = *surfaces, *find_patches(surfaces)
    for _ in range(2):
        surfaces, patches = prepare_surfaces(mesh, material, 1e-6)
        for value, right in zip((*surfaces, *patches), expected, strict=True):
            assert type(value) is type(right)
            assert np.asarray(value).dtype == np.asarray(right).dtype and np.array_equal(value, right)
        monkeypatch.setattr(module, "find_surfaces", lambda *_: pytest.fail("computed again"))


def test_prepare_surfaces_computes_again_what_changed(folder):
    """A vertex, a face, a material and the tolerance: each is another file."""
    mesh, material = box((8, 6, 2.7), (4, 3, 1.35)), np.zeros(12, int)
    shifted, reordered = (
        mesh.copy(),
        trimesh.Trimesh(mesh.vertices, np.roll(mesh.faces, 1, axis=0), process=False),
    )
    shifted.vertices[0] += 1e-9
    for arguments in (
        (mesh, material, 1e-6),
        (shifted, material, 1e-6),
        (reordered, material, 1e-6),
        (mesh, np.arange(12) // 11, 1e-6),
        (mesh, material, 2e-6),
    ):
        n_files = len(list(folder.iterdir()))
        prepare_surfaces(*arguments)
        assert len(list(folder.iterdir())) == n_files + 1


def test_prepare_surfaces_stores_no_small_mesh(folder, monkeypatch):
    monkeypatch.setattr(module, "LARGE", 13)
    surfaces, patches = prepare_surfaces(box((8, 6, 2.7), (4, 3, 1.35)), np.zeros(12, int), 1e-6)
    assert len(surfaces.facet_face) == len(patches.facet) == 6
    assert not list(folder.iterdir())
