"""What is tested: sensor designs, their materials, the rubber samples and how they are loaded."""
