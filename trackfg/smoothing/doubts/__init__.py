"""What a run's residuals, its vibration and its recording say against its sigmas; ``judgement`` puts it together."""
