"""A Pico's ADC that reads what the file adc.txt says: a value a line, for GPIO 26, 27 and 28."""


class ADC:
    def __init__(self, pin):
        with open("adc.txt") as file:  # noqa: PTH123 (MicroPython has no pathlib)
            self._value = int(file.read().split()[pin - 26])

    def read_u16(self):
        return self._value
