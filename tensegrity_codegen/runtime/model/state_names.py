"""Names of the states of a model: coordinates, then their rates, then internal states."""

from tensegrity_codegen.tables.manifest import Manifest


def name_states(manifest: Manifest) -> tuple[str, ...]:
    """Return names such as `b1.x` for node coordinates and `b1.x'` for their rates; others by their own."""
    places = manifest.coordinate_node_axis
    names = [f"{manifest.node_name[node]}.{'xyz'[axis]}" for node, axis in places]
    names = names or list(manifest.coordinate_name)
    return (*names, *(f"{name}'" for name in names), *manifest.internal_name)


def name_moving_states(manifest: Manifest) -> tuple[str, ...]:
    """Return the names of coordinates and their rates, without those of internal states."""
    return name_states(manifest)[: 2 * len(manifest.coordinate_name)]
