"""Evidence to partition to verdict, the time line of the attack, and the position that can be trusted."""
