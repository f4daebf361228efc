// The form that launches a campaign.
import "./main.js";
import { armLaunch } from "./launch.js";

armLaunch();
