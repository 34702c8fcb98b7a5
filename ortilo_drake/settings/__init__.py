"""The groups of settings that make up a scenario; users import them from ortilo_drake.scenario."""
