"""From device processes to observations: pose and picture of one instant, robot at rest."""
