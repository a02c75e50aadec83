"""Boards before known cameras: as corners with noise, and as pictures."""

from collections.abc import Iterator, Sequence
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from recorder.calibrate.board import Board, Corners
from recorder.calibrate.chessboard import Grey
from recorder.calibrate.views import BoardView, PicturePair, Sighting
from recorder.optics import to_pixels, to_rays
from recorder.records import SIDES
from recorder.rig import Camera, Floats, Rig
from tests.builders import rotation_of

CHESSBOARD = Board("chessboard", 9, 6, 0.025)
CHARUCO = Board("charuco", 7, 4, 0.03, 0.022, "4X4_50")  # 8 x 5 squares
SQUARE_TEXELS = 60


def poses(board: Board, rig: Rig, count: int, seed: int = 0) -> list[Floats]:
    """(6,) poses all over the left picture, near and far, tilted by up to 35 degrees."""
    generator = np.random.default_rng(seed)
    width_px, height_px = rig.left.size_px
    wide_m = board.columns * board.square_m
    middle_m = board.points_m.mean(axis=0)
    found: list[Floats] = []
    while len(found) < count:
        aim_px = generator.uniform((0.2, 0.2), (0.8, 0.8)) * (width_px, height_px)
        ray = to_rays(rig.left, aim_px[None])[0]
        far_m = generator.uniform(1.1, 2.4) * wide_m * rig.left.matrix[0, 0] / width_px * 1.4
        turn = generator.uniform(-0.6, 0.6, 3)
        rotation = rotation_of(turn.tolist())
        place_m = far_m * ray / np.linalg.norm(ray) - rotation @ middle_m
        pose = np.concatenate([turn, place_m])
        if all(_inside(board, pose, rig, side) for side in ("left", "right")):
            found.append(pose)
    return found


def _inside(board: Board, pose: Floats, rig: Rig, side: str) -> bool:
    """Whether the whole board with its margin is in a picture."""
    px = seen(board, pose, rig, side)
    width_px, height_px = rig.camera(side).size_px
    margin = 0.04 * width_px
    low, high = px.min(axis=0), px.max(axis=0)
    return bool((low > margin).all() and (high < np.array([width_px, height_px]) - margin).all())


def seen(board: Board, pose: Floats, rig: Rig, side: str) -> Floats:
    """(N, 2) where a camera truly sees the board's corners."""
    placed = board.points_m @ rotation_of(pose[:3].tolist()).T + pose[3:]
    if side == "right":
        placed = placed @ rig.rotation.T + rig.translation_m
    return to_pixels(rig.camera(side), placed)


def sighting(
    rig: Rig,
    *,
    board: Board = CHESSBOARD,
    count: int = 12,
    noise_px: float = 0.15,
    seed: int = 0,
) -> Sighting:
    """What both cameras see of a board, with noise, and no picture."""
    generator = np.random.default_rng(seed + 1000)
    views = []
    for place, pose in enumerate(poses(board, rig, count, seed)):
        corners = []
        for side in SIDES:
            px = seen(board, pose, rig, side)
            px = px + generator.normal(0, noise_px, px.shape)
            corners.append(Corners(np.arange(len(px)), px))
        views.append(
            BoardView(f"view{place:02d}", corners[0], corners[1], (500.0, 500.0), (False, False))
        )
    return Sighting(board, tuple(views), rig.left.size_px, rig.right.size_px)


def wide_rig(rig: Rig) -> Rig:
    """The same with the focal lengths of a wide lens, 90 degrees across."""
    cameras = []
    for camera in (rig.left, rig.right):
        matrix = camera.matrix.copy()
        matrix[[0, 1], [0, 1]] *= 0.55
        cameras.append(Camera(camera.size_px, matrix, camera.distortion, camera.lens))
    return Rig(cameras[0], cameras[1], rig.rotation, rig.translation_m / 2)


# pictures


@lru_cache(maxsize=4)
def texture(board: Board, *, legacy: bool = False) -> Grey:
    """The printed board, a square's margin around it."""
    across, down = board.squares
    size = (across * SQUARE_TEXELS, down * SQUARE_TEXELS)
    if board.marker_m is None:
        rows, columns = np.mgrid[: size[1], : size[0]] // SQUARE_TEXELS
        printed = np.where((rows + columns) % 2, 235, 20).astype(np.uint8)
    else:
        dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
        drawn = cv2.aruco.CharucoBoard(board.squares, board.square_m, board.marker_m, dictionary)
        drawn.setLegacyPattern(legacy)
        printed = np.asarray(drawn.generateImage(size), np.uint8)
        printed = (20 + printed * (215 / 255)).astype(np.uint8)
    return np.asarray(np.pad(printed, SQUARE_TEXELS, constant_values=235), np.uint8)


@lru_cache(maxsize=8)
def _rays(camera: Camera, fine: int) -> npt.NDArray[np.float32]:
    """(H, W, 3) float32 rays of a picture `fine` times as fine as the camera's."""
    width_px, height_px = camera.size_px
    y, x = (np.mgrid[: height_px * fine, : width_px * fine] + 0.5) / fine - 0.5
    rays = to_rays(camera, np.column_stack([x.ravel(), y.ravel()]))
    return np.nan_to_num(rays).astype(np.float32).reshape(height_px * fine, width_px * fine, 3)


def render(
    board: Board, pose: Floats, rig: Rig, side: str, *, seed: int = 0, legacy: bool = False
) -> Grey:
    """A picture of the board: through the lens, a little blurred, with the noise of a camera."""
    camera, fine = rig.camera(side), 2
    rotation, place_m = rotation_of(pose[:3].tolist()), pose[3:]
    if side == "right":
        rotation, place_m = rig.rotation @ rotation, rig.rotation @ place_m + rig.translation_m
    # a board's point is homography @ (x, y, 1) before the camera
    homography = np.column_stack([rotation[:, 0], rotation[:, 1], place_m])
    on_board = _rays(camera, fine) @ np.linalg.inv(homography).T.astype(np.float32)
    with np.errstate(divide="ignore", invalid="ignore"):
        places = on_board[..., :2] / (on_board[..., 2:] * np.float32(board.square_m))
    # the first inner corner is two squares from the texture's edge; texel centres are integers
    texels = (places + 2) * SQUARE_TEXELS - np.float32(0.5)
    texels[~(on_board[..., 2] > 0)] = -1e4
    printed = texture(board, legacy=legacy)
    shown = cv2.remap(printed, texels[..., 0], texels[..., 1], cv2.INTER_LINEAR, borderValue=(120,))
    sharp = cv2.resize(shown, camera.size_px, interpolation=cv2.INTER_AREA)
    noise = np.random.default_rng(seed).normal(0, 1.5, sharp.shape)
    soft = cv2.GaussianBlur(sharp.astype(float), (0, 0), 0.6) + noise
    return np.asarray(np.clip(np.rint(soft), 0, 255), np.uint8)


class Shown:
    """Rendered pairs, each drawn once however often they are gone through."""

    def __init__(
        self, rig: Rig, board: Board, board_poses: Sequence[Floats], *, legacy: bool = False
    ) -> None:
        self.pairs = [
            PicturePair(
                f"view{place:02d}",
                render(board, pose, rig, "left", seed=2 * place, legacy=legacy),
                render(board, pose, rig, "right", seed=2 * place + 1, legacy=legacy),
            )
            for place, pose in enumerate(board_poses)
        ]

    def __call__(self) -> Iterator[PicturePair]:
        yield from self.pairs
