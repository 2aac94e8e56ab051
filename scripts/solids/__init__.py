"""The project's own shapes, each made by a procedure in a file of its name."""
