"""A standing robot at rest: payloads, slopes, load cases, drive envelopes, stow poses, sensitivities."""
