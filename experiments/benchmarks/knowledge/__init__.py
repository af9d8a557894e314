"""What knowledge bases know, after how many reaches, and how fast; and in one region of the work space."""
