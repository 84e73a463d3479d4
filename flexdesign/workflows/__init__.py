"""What a user asks in one command: validate a design, sweep it, size it, reproduce a paper."""
