"""What both sides of a comparison may share: statistics of the Ornstein-Uhlenbeck process, Hermite functions."""
