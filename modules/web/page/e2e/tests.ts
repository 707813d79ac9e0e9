// The page as people meet it, in a browser, against the live simulated robot.
import "./pairing";
import "./driving";
import "./network";
import "./authority";
import "./stopping";
import "./status";
import "./language";
import "./map";
import "./panels";
import "./simulation";
import "./logs";
import "./everywhere";
import "./newcomer";
import "./guard";
import "./foxglove";
