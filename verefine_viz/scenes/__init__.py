"""Where problems come from: BOP folders, results files, detections, built-in demo scenes."""
