"""One file per kind of contact, with what all share: pyramid, modes, automaton, laws."""
