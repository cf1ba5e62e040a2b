"""The ensemble of motions: starts that keep what they must, and a peer that comes to the same end."""

import ensembles
import numpy as np
import pytest

from tensegrity_codegen.pipeline.compile_scene import load_nodes


def test_starts_keep_the_lengths_of_bars_and_what_is_held() -> None:
    structure = load_nodes(ensembles.SCENE)
    place, speed = ensembles.make_starts(structure, 5)
    bars = structure.connectivity[structure.is_bar]
    vector = place[:, bars[:, 0]] - place[:, bars[:, 1]]
    length = np.linalg.norm(vector, axis=2)
    np.testing.assert_allclose(
        length, np.tile(structure.member_length()[structure.is_bar], (5, 1)), rtol=1e-12
    )
    along = np.sum(vector * (speed[:, bars[:, 0]] - speed[:, bars[:, 1]]), axis=2)
    assert np.abs(along).max() < 1e-14
    held = structure.node_anchored
    np.testing.assert_array_equal(place[:, held], np.tile(structure.node_position[held], (5, 1)))
    assert not speed[:, held].any()
    assert np.abs(place - structure.node_position).max() > ensembles.DISPLACED / 2


@pytest.mark.peers
def test_a_line_is_the_cheapest_setting_that_meets_the_error() -> None:
    pytest.importorskip("mujoco")
    ensemble = ensembles.Ensemble(ensembles.make_structure(), 9, 0.05, None)
    assert ensemble.apart < 1e-10
    own = ensembles.find_own(ensemble, "node_position", "rk853", (1.0, 1e-4, 1e-8), 1e-6)
    assert own is not None
    assert own.error <= 1e-6
    assert own.count == 9
    assert own.setting < 1.0
    assert ensembles.find_own(ensemble, "rigid_bar", "rk853", (1e-4, *[1e-8] * 6), 1e-9) is None
    makers = dict(ensembles.list_peers(ensemble, 2))["MuJoCo RK4"]
    peer = ensembles.find_peer(ensemble, makers, (1e-2, 1e-3), 1e-6)  # parts of the time
    assert peer is not None
    assert peer.count == 2
    assert ensembles.find_peer(ensemble, makers, (1e-2,), 1e-14) is None
