"""The library: ``import verefine_viz as vv`` gives what its modules have."""
