"""The commands of ``verefine-viz``, one file each. Heavy imports stay inside ``run``, so that --help is instant."""
