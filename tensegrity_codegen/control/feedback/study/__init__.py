"""A study of feedback: weights from the scene, disturbances, loops over many draws, the record of it."""
