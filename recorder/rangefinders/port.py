"""The serial port of a rangefinder, through pyserial."""

from typing import Any

from recorder.equipment import RangefinderSettings
from recorder.errors import PomologError
from recorder.rangefinders import LineProtocol


class SerialPort:
    """An open port, always 8 data bits without parity: parity is checked where it is counted.

    Raises:
        PomologError: no such port, or another program has it.
    """

    def __init__(self, settings: RangefinderSettings, protocol: LineProtocol) -> None:
        try:
            import serial
        except ImportError:
            raise PomologError(
                "rangefinders need pyserial; try: pip install 'pomolog[serial]'"
            ) from None
        self._error: type[Exception] = serial.SerialException
        self.name = settings.port
        try:
            self._port: Any = serial.Serial(
                settings.port,
                settings.baud or protocol.baud,
                timeout=0.05,
                write_timeout=0.5,
                exclusive=True,
            )
        except (self._error, OSError, ValueError) as error:
            raise PomologError(
                f"no rangefinder at {settings.port} ({error}); is it plugged in?"
            ) from None

    def write(self, command: bytes) -> None:
        """Send a command.

        Raises:
            PomologError: the port is gone.
        """
        try:
            self._port.write(command)
        except (self._error, OSError) as error:
            raise PomologError(
                f"the rangefinder at {self.name} is gone ({error}); it is opened again"
            ) from None

    def read(self) -> bytes:
        """What has come within a twentieth of a second.

        Raises:
            PomologError: the port is gone.
        """
        try:
            first: bytes = self._port.read(1)
            return first + self._port.read(self._port.in_waiting) if first else b""
        except (self._error, OSError, TypeError) as error:  # pyserial's TypeError: closed meanwhile
            raise PomologError(
                f"the rangefinder at {self.name} is gone ({error}); it is opened again"
            ) from None

    def close(self) -> None:
        """Close the port; one that is gone closes without a word."""
        try:
            self._port.close()
        except (self._error, OSError):
            return
