"""Tables, pictures and animations of structures and of what was computed from them."""
