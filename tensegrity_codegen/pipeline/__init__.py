"""From a scene to a compiled library, one function a step."""
