"""What every package imports: types, settings, protocols, errors, geometry, and files read and written safely."""
