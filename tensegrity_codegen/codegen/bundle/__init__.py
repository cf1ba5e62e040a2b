"""What a folder with a library has besides its sources: an example, build files, a page and a notice."""
