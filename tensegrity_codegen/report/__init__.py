"""Tables, pictures and animations of structures and of their results."""
