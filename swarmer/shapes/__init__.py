"""Point clouds: catalogue, readers, exact-count sampling, neighbour planning, pictures.

    catalogue.load_shape     a name or a file becomes a checked PointCloud
    neighbours               who is whose planned neighbour, and the table of nearest points
    drawing, braille         a cloud as a PNG, a cloud in the terminal

Nothing is imported here, so that naming this room costs no numpy.
"""
