"""What the state machine is made of: pure rules, each in its own small file (SwarMer, section 4)."""
