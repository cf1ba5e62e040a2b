"""Files beside the sources in the folder of a library: an example, build files, a page and a notice."""
