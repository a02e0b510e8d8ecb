"""What is made of runs and scenes: certification, measured rates, pictures, words."""
