"""Types and contracts: geometry, camera, observation, problem, records, settings, protocols."""
